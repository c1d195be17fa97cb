"""Progress bars of rich on standard error."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from sshade.core.progress import Progress

if TYPE_CHECKING:
    from rich.progress import Progress as Bars

#: Number of stages that are shown after their end, so that a screen has room for the stages that run.
ENDED = 5


def stage_bars(**options: Any) -> Bars:
    """Return progress bars of rich for standard error. They vanish at the end of a ``with`` block.

    They show no remaining time, because an iteration may converge at any time. `options` go to
    ``rich.progress.Progress``.
    """
    from rich import progress as rich
    from rich.console import Console

    columns = (
        *(rich.TextColumn("{task.description:<26}"), rich.BarColumn(), rich.MofNCompleteColumn()),
        *(rich.TimeElapsedColumn(), rich.TextColumn("{task.fields[note]}")),
    )
    # Print above the bars if standard output is the same terminal.
    redirect = sys.stdout.isatty()
    console = Console(stderr=True)
    return rich.Progress(*columns, console=console, redirect_stdout=redirect, transient=True, **options)


def stage_progress(bars: Bars) -> Progress:
    """Return a callback that draws one bar for each stage, and hides stages that ended long ago."""
    tasks: dict[str, Any] = {}
    ended: list[str] = []

    def progress(stage: str, done: int, total: int, note: str = "") -> None:
        if stage not in tasks:
            tasks[stage] = bars.add_task(stage, total=total, note=note)
        if stage in ended and done < total:  # another pass, such as a correction of the volume
            ended.remove(stage)
            bars.reset(tasks[stage], completed=done, total=total, note=note)
        bars.update(tasks[stage], completed=done, total=total, note=note, visible=True)
        if done >= total and stage not in ended:
            ended.append(stage)
            for earlier in ended[:-ENDED]:
                bars.update(tasks[earlier], visible=False)

    return progress

"""Progress of a sweep: a line for each finished run of all workers, and a bar on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Lock, Thread
from typing import Any

from eval.run.record import SweepRecord, counts, run_line
from sshade.core.bars import stage_bars, stage_progress
from sshade.core.progress import Progress, silent

#: Seconds between two readings of the record, for runs of other processes.
PERIOD = 1.0

#: Time in seconds over which the bar averages its speed; long enough for a whole sweep.
_WEEK = 7 * 24 * 3600.0


class Monitor:
    """Follows the record of a sweep.

    Parameters
    ----------
    record : SweepRecord
    folders : sequence of path
        Folders that the runs are written to.
    watch : bool
        Read the record every second, for runs in other processes. Otherwise, call :meth:`update` after each
        run.
    """

    def __init__(self, record: SweepRecord, folders: Sequence[Path] = (), *, watch: bool) -> None:
        self.record, self.folders = record, folders
        self.sweep = record.sweep()
        self._told = 0
        self._lock = Lock()
        self._over = Event()
        self._bars: Any = None
        if sys.stderr.isatty():
            self._bars = stage_bars(remaining="sweep", speed_estimate_period=_WEEK)
            self._bars.start()
            self._bar = self._bars.add_task("sweep", total=len(self.sweep.runs), note="")
        self._watcher = Thread(target=self._watch, daemon=True) if watch else None
        if self._watcher is not None:
            self._watcher.start()

    def update(self) -> None:
        """Print the runs that ended since the last call."""
        with self._lock:
            ended = self.record.ended()
            for i in range(self._told, len(ended)):
                text = run_line(ended[i])
                if self._bars is None:  # the bar shows the same counts
                    text += f" [{counts(self.sweep, ended[: i + 1])}]"
                print(text, flush=True)  # noqa: T201
            self._told = len(ended)
            if self._bars is not None and ended:
                # Runs with an earlier row take no time and would distort the estimate of the remaining time.
                found = sum(bool(run.found) for run in ended)
                total, done = len(self.sweep.runs) - found, len(ended) - found
                note = counts(self.sweep, ended).partition(", ")[2]
                self._bars.update(self._bar, total=total, completed=done, note=note)

    @contextmanager
    def run_progress(self) -> Iterator[Progress]:
        """Show the progress of a run in this process below the bar of the sweep."""
        if self._bars is None:
            yield silent
            return
        before = set(self._bars.task_ids)
        try:
            yield stage_progress(self._bars)
        finally:
            for task in set(self._bars.task_ids) - before:
                self._bars.remove_task(task)

    def close(self) -> None:
        """Print the remaining finished runs and end the display."""
        self._over.set()
        if self._watcher is not None:
            self._watcher.join()
        try:
            self.update()
        finally:
            if self._bars is not None:
                self._bars.stop()

    def _watch(self) -> None:
        while not self._over.wait(PERIOD):
            self.update()

"""A sweep on the screen: a line for each run that ended, wherever it ran, and a bar on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Lock, Thread
from typing import Any

from eval.run.record import SweepRecord, counts, run_line
from sshade.cli.console import stage_bars, stage_progress
from sshade.progress import Progress, silent

#: Seconds between two looks at the record, for runs of other processes.
PERIOD = 1.0

#: Seconds that the bar's estimate of the time left looks back on: all of a sweep.
_WEEK = 7 * 24 * 3600.0


class Monitor:
    """Follows the record of a sweep, from the start on.

    Parameters
    ----------
    record : SweepRecord
    watch : bool
        Look at the record every second, for runs in other processes; otherwise
        :meth:`update` is to be called after each run.
    """

    def __init__(self, record: SweepRecord, *, watch: bool) -> None:
        self.record = record
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
        """Tell of the runs that ended since the last call."""
        with self._lock:
            ended = self.record.ended()
            for i in range(self._told, len(ended)):
                text = run_line(ended[i])
                if self._bars is None:  # which say the same
                    text += f" [{counts(self.sweep, ended[: i + 1])}]"
                print(text, flush=True)  # noqa: T201
            self._told = len(ended)
            if self._bars is not None and ended:
                kept = sum(
                    bool(run.found) for run in ended
                )  # these take no time, and would mislead the estimate
                total, done = len(self.sweep.runs) - kept, len(ended) - kept
                note = counts(self.sweep, ended).partition(", ")[2]
                self._bars.update(self._bar, total=total, completed=done, note=note)

    @contextmanager
    def run_progress(self) -> Iterator[Progress]:
        """Progress of a run in this process, drawn under the sweep's bar while it lasts."""
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
        """End; what happened until now has been told."""
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

"""A sweep on the screen: a line for each run that ended, wherever it ran, and a bar on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from threading import Event, Lock, Thread
from typing import Any

from eval.run.sweep import SweepRecord, told_counts, told_run
from sshade.cli.console import stage_bars, stage_progress
from sshade.task import Progress, silent

#: Seconds between two looks at the record, for runs of other processes.
PERIOD = 1.0


class Monitor:
    """Follows the record of a sweep.

    Parameters
    ----------
    record : SweepRecord
    watch : bool
        Look at the record every second, for runs in other processes; otherwise
        :meth:`update` is to be called after each run.
    """

    def __init__(self, record: SweepRecord, *, watch: bool) -> None:
        self.record = record
        self.plan = record.plan()
        self._told = 0
        self._lock = Lock()
        self._over = Event()
        self._watcher = Thread(target=self._watch, daemon=True) if watch else None
        self._bars: Any = None

    def start(self) -> None:
        """Begin to draw and to watch."""
        if sys.stderr.isatty():
            self._bars = stage_bars()
            self._bars.start()
            self._sweep = self._bars.add_task("sweep", total=len(self.plan.runs), note="")
        if self._watcher is not None:
            self._watcher.start()

    def update(self) -> None:
        """Tell of the runs that ended since the last call."""
        with self._lock:
            ended = self.record.ended()
            now = datetime.now(UTC)
            for i in range(self._told, len(ended)):
                text = told_run(ended[i])
                if self._bars is None:  # which say the same
                    text += f" [{told_counts(self.plan, ended[: i + 1], now=now)}]"
                print(text, flush=True)  # noqa: T201
            self._told = len(ended)
            if self._bars is not None and ended:
                counts = told_counts(self.plan, ended, now=now)
                self._bars.update(self._sweep, completed=len(ended), note=counts.partition(", ")[2])

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

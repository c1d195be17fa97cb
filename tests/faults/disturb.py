"""Killing at random moments, and two of a kind at once."""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from pathlib import Path
from time import sleep

import numpy as np

from tests.faults.scenes import Result, Scene, clear

#: Kills between two reruns to the end.
IN_A_ROW = 5


def undisturbed(scene: Scene, folder: Path) -> tuple[Result, float]:
    """The result of a run to the end, and the seconds of its work."""
    scene.prepare(folder)
    seconds = scene.run(folder)
    result = scene.result(folder / scene.out)
    assert result, f"{scene.name} left nothing"
    clear(scene, folder)
    return result, seconds


def kill_at_random(
    scene: Scene, folder: Path, *, kills: int, expected: Result, seconds: float, seed: int = 0
) -> None:
    """Kill a scene so many times; what it left is whole, and a rerun's result the undisturbed one.

    Every other kill takes the process alone, the others its workers too.
    """
    rng, done, since = np.random.default_rng(seed), 0, 0
    while done < kills:
        run = scene.start(folder)
        while not (folder / scene.out).exists() and run.process.is_alive():
            sleep(0.001)
        # Now and then before or just after the beginning, where little is there yet.
        sleep(float(rng.uniform(0, seconds) if rng.integers(4) else rng.uniform(0, 0.05)))
        if run.process.is_alive():
            _kill(run.process.pid, workers=done % 2 == 0)
            done, since = done + 1, since + 1
        run.end()
        scene.check(folder / scene.out)
        if since >= IN_A_ROW or done == kills or run.process.exitcode == 0:
            scene.run(folder)
            assert scene.result(folder / scene.out) == expected, f"{scene.name}: another result after kills"
            clear(scene, folder)
            since = 0


def _kill(pid: int, *, workers: bool) -> None:
    if workers:
        with suppress(ProcessLookupError):  # so young that it leads no group yet
            os.killpg(pid, signal.SIGKILL)
            return
    os.kill(pid, signal.SIGKILL)


def two_at_once(scene: Scene, folder: Path, *, expected: Result) -> list[int]:
    """Exit codes of two that were started together; their result is that of one."""
    runs = [scene.start(folder, log) for log in ("one", "two")]
    codes = []
    for run in runs:
        run.end()
        codes.append(run.process.exitcode)
        assert codes[-1] == 0 or "builds there; wait until it is done" in run.output, run.output
    assert 0 in codes, "both were refused"
    assert scene.result(folder / scene.out) == expected, f"{scene.name}: another result of two at once"
    clear(scene, folder)
    return codes

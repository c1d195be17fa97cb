"""Builds and runs that are killed at any change of a file lose nothing; nor do two runs at once."""

import builtins
import io
import json
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from defaust.build.dataset import build
from defaust.build.verify import verify
from eval.run.config import RunConfig, RunSettings
from eval.run.run import run
from tests.defaust.toy import KEPT, Balls
from tests.files import contents

METHOD = {"_target_": "baselines.identity.identity"}
CASE = {"_target_": "defaust.tasks.hairpin.hairpin_task", "gap": 0.02, "angle": 40.0, "around": 12}
#: Beginnings of the names of columns that record the time and place of a run, not its result.
VARYING = ("seconds.", "date", "env.", "peak_mib")
#: Calls that change files.
CHANGES = [(os, name) for name in ("replace", "rename", "unlink", "rmdir", "mkdir")]
CHANGES += [(io, "open"), (builtins, "open")]


class Killed(BaseException):
    """The end of the process."""


@contextmanager
def watched(act: Callable[[int], None]) -> Iterator[None]:
    """Call a function with the number of each change: before the change, or when a file to write is empty."""
    numbers = count()

    def changing(call: Callable[..., Any]) -> Callable[..., Any]:
        def changed(*args: Any, **settings: Any) -> Any:
            act(next(numbers))
            return call(*args, **settings)

        return changed

    def opened(path: Any, mode: str = "r", *args: Any, **settings: Any) -> Any:
        file = plain_open(path, mode, *args, **settings)
        if set(mode) & set("wax+"):
            with ExitStack() as stack:
                stack.callback(file.close)
                act(next(numbers))
                stack.pop_all()
        return file

    plain_open = open
    with ExitStack() as stack:
        for module, name in CHANGES:
            new = opened if name == "open" else changing(getattr(module, name))
            stack.enter_context(mock.patch.object(module, name, new))
        yield


def killed_at(number: int, work: Callable[[Path], None], out: Path) -> bool:
    """Do some work in `out`, and kill it at a change; return whether there are so many changes."""
    ended = subprocess.Popen(["true"])
    ended.wait()
    killed = False

    def act(now: int) -> None:
        nonlocal killed
        if now >= number:  # what would tidy up is dead as well
            killed = True
            raise Killed

    # Files that a kill leaves have the number of a process that has ended.
    with watched(act), mock.patch("os.getpid", return_value=ended.pid), suppress(Killed):
        work(out)
    return killed


def taken(out: Path) -> dict[str, Any]:
    """Return the content of all files, rows without varying columns; remove the folder."""
    if (out / "dataset.json").is_file():
        assert verify(out) == []
    found: dict[str, Any] = contents(out)
    for name in (name for name in found if name.endswith("row.json")):
        row = json.loads(found[name])
        found[name] = {column: value for column, value in row.items() if not column.startswith(VARYING)}
    shutil.rmtree(out)
    return found


def assert_whole(out: Path) -> None:
    """Assert that every subject has all its files, and every row its vertices."""
    assert all(len(list(subject.iterdir())) == 6 for subject in out.glob("subject_*"))
    for row in out.rglob("row.json"):
        assert json.loads(row.read_text())["status"] == "ok"
        assert (row.parent / "vertices.npy").stat().st_size > 1000


def build_balls(out: Path) -> None:
    build(Balls(subjects=(0,)), out, options=KEPT, workers=1)


def make_run(out: Path) -> None:
    settings = RunSettings("e", "e", None, force=False, fresh=False, of=1, time_limit=None)
    assert run(RunConfig("none", METHOD, CASE, 0, settings, out)).row["status"] == "ok"


@pytest.mark.parametrize(("work", "changes"), [(build_balls, 20), (make_run, 5)])
def test_a_kill_at_any_change_leaves_whole_files_and_a_rerun_completes_them(work, changes, tmp_path):
    out = tmp_path / "out"
    work(out)
    expected = taken(out)
    for number in count():
        if not killed_at(number, work, out):
            break
        assert_whole(out)
        work(out)
        assert taken(out) == expected, f"change {number}"
    assert number > changes


def test_two_runs_at_once_give_what_one_gives(tmp_path):
    out = tmp_path / "out"
    make_run(out)
    expected = taken(out)
    for number in count():
        numbers = []

        def act(now, number=number, numbers=numbers):
            numbers.append(now)
            if now == number:
                make_run(out)

        with watched(act):
            make_run(out)
        assert taken(out) == expected, f"change {number}"
        if len(numbers) <= number:
            break
    assert number > 5

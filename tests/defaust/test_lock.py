"""One build at a time in a folder, also after one was killed."""

import errno
import os
import subprocess
import sys

import pytest

from defaust.build import lock as module
from defaust.build.dataset import build
from defaust.build.lock import LOCK, sole_builder
from sshade import InputError
from tests.defaust.toy import OPTIONS, Balls

HOLD = (
    "import sys, time; from pathlib import Path; from defaust.build.lock import sole_builder\n"
    "with sole_builder(Path(sys.argv[1])): print('held', flush=True); time.sleep(60)"
)


def test_a_second_builder_is_refused_and_told_of_the_first(tmp_path):
    out = tmp_path / "out"
    with (
        sole_builder(out),
        pytest.raises(InputError, match=f"process {os.getpid()} on .* builds there; wait"),
    ):
        build(Balls(), out, options=OPTIONS, workers=1)
    assert not out.exists()  # made for the lock, and empty
    with sole_builder(out):  # free again
        (out / "file").write_text("x")
    assert [p.name for p in out.iterdir()] == ["file"]


def test_a_killed_process_leaves_no_lock(tmp_path):
    command = [sys.executable, "-c", HOLD, tmp_path]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "held\n"
        with pytest.raises(InputError, match=f"process {process.pid} on"), sole_builder(tmp_path):
            pass
        process.kill()
    assert (tmp_path / LOCK).is_file()
    with sole_builder(tmp_path):
        assert (tmp_path / LOCK).read_text().startswith(f"process {os.getpid()} on ")
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_the_other_removes_at_its_end_is_not_taken_for_a_lock(tmp_path, monkeypatch):
    real, calls = os.stat, []

    def removed_first(path, *args, **kwargs):
        if str(path).endswith(LOCK):
            calls.append(path)
            if len(calls) == 1:
                os.unlink(path)
        return real(path, *args, **kwargs)

    monkeypatch.setattr(module.os, "stat", removed_first)
    with sole_builder(tmp_path), pytest.raises(InputError), sole_builder(tmp_path):
        pass
    assert len(calls) == 2


def test_without_locks_it_goes_on_with_a_warning(tmp_path, monkeypatch, caplog):
    def none(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(module.fcntl, "flock", none)
    with sole_builder(tmp_path):
        assert (tmp_path / LOCK).is_file()
    assert "no lock can be had (No locks available)" in caplog.text


def test_a_build_killed_before_its_recipe_is_taken_up(tmp_path):
    out = tmp_path / "out"
    (out / ".build").mkdir(parents=True)
    (out / LOCK).write_text("process 1 on mars")
    document = build(Balls(subjects=(0,)), out, options=OPTIONS, workers=1)
    assert len(document["subjects"]) == 1 and not (out / LOCK).exists()


def test_a_system_without_such_locks_is_told_about(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(module, "fcntl", None)
    with module.sole_builder(tmp_path / "out"):
        assert (tmp_path / "out" / module.LOCK).exists()
    assert "start no second build there" in caplog.text
    assert not (tmp_path / "out").exists()

"""One build at a time in a folder, also after a build was killed."""

import errno
import os
import subprocess
import sys
from io import FileIO

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


def test_a_second_builder_is_refused_with_the_name_of_the_first(tmp_path):
    out = tmp_path / "out"
    with (
        sole_builder(out),
        pytest.raises(InputError, match=f"process {os.getpid()} on .* builds there; wait"),
    ):
        build(Balls(), out, options=OPTIONS, workers=1)
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
    (tmp_path / ".build").mkdir()
    document = build(Balls(subjects=(0,)), tmp_path, options=OPTIONS, workers=1)
    assert len(document["subjects"]) == 1 and not (tmp_path / LOCK).exists()


def test_without_locks_a_build_continues_with_a_warning(tmp_path, monkeypatch, caplog):
    def none(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(module.fcntl, "flock", none)
    with sole_builder(tmp_path):
        pass
    assert "cannot be locked (No locks available)" in caplog.text
    monkeypatch.setattr(module, "fcntl", None)  # as on Windows
    with sole_builder(tmp_path / "out"):
        assert (tmp_path / "out").is_dir()
    assert "no file locks; start no second build" in caplog.text


def test_a_lock_file_that_was_removed_meanwhile_locks_nothing(tmp_path, monkeypatch):
    """Another build ends between the opening and the locking of its file."""
    original = module.fcntl.flock

    def removing(file, operation):
        monkeypatch.setattr(module.fcntl, "flock", original)
        (tmp_path / LOCK).unlink()
        original(file, operation)

    monkeypatch.setattr(module.fcntl, "flock", removing)
    with sole_builder(tmp_path), pytest.raises(InputError, match="builds there"), sole_builder(tmp_path):
        pass


def test_a_new_folder_that_stays_empty_is_removed(tmp_path):
    with sole_builder(tmp_path / "out"):
        pass
    assert not (tmp_path / "out").exists()


class Full(FileIO):
    """File on a full disk."""

    def write(self, _):
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_leaves_no_lock(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_locked", lambda out: Full(out / LOCK, "a+"))
    with pytest.raises(OSError, match="No space left"), sole_builder(tmp_path / "out"):
        pass
    assert not (tmp_path / "out").exists()

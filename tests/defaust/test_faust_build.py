"""Whole builds of a folder laid out as FAUST's: resumed after a kill, elsewhere, in full."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import pytest

from defaust.build.dataset import build
from defaust.cli import main
from defaust.folder.record import read_dataset
from defaust.folder.verify import verify
from defaust.tasks import list_tasks, load_task
from sshade import InputError
from tests.defaust.registrations import SMALL, contents, faust, write_faust

ARGUMENTS = ["source=faust", "target_vertices=3000", "window=[0.7,1.5]", "remesh_iterations=2"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_faust(tmp_path_factory.mktemp("here") / "training/registrations", subjects=range(10))


@pytest.fixture(scope="module")
def whole(folder, tmp_path_factory):
    """All ten subjects."""
    out = tmp_path_factory.mktemp("whole") / "faust"
    build(faust(folder), out, options=SMALL, workers=2)
    return out


def test_ten_subjects_give_forty_tasks(whole):
    assert verify(whole) == []
    assert list_tasks(whole) == [(s, k) for s in range(10) for k in range(1, 5)]
    document = read_dataset(whole)
    assert document["name"] == "defaust-faust" and len(document["source"]["files"]) == 50
    assert [p["name"] for p in document["subjects"][9]["poses"]][-1] == "8_walking"
    tasks = [load_task(whole, subject=0, pose=k, resolution="low") for k in range(1, 5)]
    assert [len(set(task.handles.group)) for task in tasks] == [7, 7, 7, 15]
    assert [len(task.handles) for task in tasks] == [210, 210, 210, 450]
    assert all(task.truth.shape == (6890, 3) for task in tasks)
    assert all("poses 1, 3, 6, 8, the rest pose 0 and" in task.meta["note"] for task in tasks)


def test_card_and_info_show_the_facts(whole, capsys):
    card = (whole / "README.md").read_text()
    assert "are a guess" in card and "may be redistributed" in card and "Read from 50 files" in card
    assert main(["info", str(whole)]) == 0
    text = capsys.readouterr().out
    assert "user's own copy" in text and "Unit: metre. Axes: y up" in text and "3_forearms_raised" in text


def test_killed_and_run_again_elsewhere_is_byte_identical(whole, folder, tmp_path, capsys):
    there = write_faust(tmp_path / "elsewhere", subjects=[0, 1])
    out = tmp_path / "out"
    command = [f"source.root={there}", f"out={out}", "subjects=[0,1]", "workers=1"]
    process = subprocess.Popen([sys.executable, "-m", "defaust", "build", *ARGUMENTS, *command])
    for _ in range(600):
        if (out / ".build/subject_00.json").is_file() or process.poll() is not None:
            break
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert (out / ".build/subject_00.json").is_file() and not (out / "dataset.json").exists()
    first = (out / "subject_00/rest.ply").stat().st_mtime_ns

    assert main(["build", *ARGUMENTS, *command]) == 0
    assert (out / "subject_00/rest.ply").stat().st_mtime_ns == first
    build(faust(folder), tmp_path / "again", options=replace(SMALL, subjects=(0, 1)), workers=2)
    assert contents(out) == contents(tmp_path / "again")
    assert str(tmp_path) not in (out / "dataset.json").read_text()
    # A subject does not depend on which others are built.
    for name in ("rest.ply", "pose_4.json", "pose_2_low.ply"):
        assert (out / "subject_01" / name).read_bytes() == (whole / "subject_01" / name).read_bytes()


def test_a_changed_file_or_landmark_is_another_source(whole, folder, tmp_path):
    with pytest.raises(InputError, match="source.landmark_vertices.nose was 332 and is now 333"):
        build(faust(folder, "source.landmarks.nose=333"), whole, options=SMALL, workers=1)
    there = write_faust(tmp_path / "elsewhere", subjects=range(10))
    (there / "tr_reg_011.ply").write_bytes((there / "tr_reg_013.ply").read_bytes())
    with pytest.raises(InputError, match="source.files.tr_reg_011.ply was '.*' and is now '"):
        build(faust(there), whole, options=SMALL, workers=1)


def test_missing_files_are_named_before_anything_is_built(tmp_path, capsys):
    there = write_faust(tmp_path / "elsewhere")
    out = tmp_path / "out"
    assert main(["build", *ARGUMENTS, f"source.root={there}", f"out={out}"]) == 2
    assert "those of subjects=[0] are there" in capsys.readouterr().err
    assert not out.exists()

"""Builds: determinism, resuming, refused configurations, and verify, which finds every kind of damage."""

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import tracemalloc
from dataclasses import replace
from time import sleep
from unittest.mock import Mock

import psutil
import pytest

from defaust.build import workers as module
from defaust.build.dataset import _difference, build
from defaust.build.verify import verify
from defaust.folder.layout import sha256
from defaust.folder.record import read_dataset
from defaust.schema import mismatch
from sshade import InputError
from sshade.files.meshes import read_mesh, write_mesh
from tests.defaust.toy import KEPT, OPTIONS, Balls, change, change_handles, flip_a_byte, relist
from tests.files import contents
from tests.full import few
from tests.kernels import OFFERED
from tests.shapes import beside, shifted

#: Command that builds a small dataset whose files and record hold sums of products.
NOISY = [sys.executable, "-m", "defaust", "build", "source=noisy", "subjects=[6]", "target_vertices=null"]


@pytest.fixture(scope="module")
def noisy(tmp_path_factory):
    """The dataset of :data:`NOISY`, with the kernels that the library chooses; do not change it."""
    out = tmp_path_factory.mktemp("data") / "noisy"
    subprocess.run([*NOISY, f"out={out}"], check=True)
    return out


def test_builds_are_byte_identical_with_any_number_of_workers(finished, tmp_path):
    build(Balls(), tmp_path / "again", options=OPTIONS, workers=2)
    assert contents(tmp_path / "again") == contents(finished)


@pytest.mark.parametrize("kernels", few(OFFERED, *OFFERED[:1]))
def test_a_build_is_the_same_with_other_kernels_of_the_library(kernels, noisy, tmp_path):
    """Noise, and the fitted rotations of handles, are sums of products."""
    variables = {"OPENBLAS_CORETYPE": kernels, "OPENBLAS_NUM_THREADS": "2"}
    subprocess.run([*NOISY, f"out={tmp_path / 'noisy'}"], env=os.environ | variables, check=True)
    assert contents(tmp_path / "noisy") == contents(noisy)


def test_a_killed_build_is_resumed(finished, tmp_path, monkeypatch):
    out = tmp_path / "balls"
    original, built = module.build_subject, []

    def killed(source, folder, *, subject, **options):
        if subject == 1:  # a killed build leaves half a subject without a record
            (folder / ".subject_01.partial").mkdir()
            (folder / ".subject_01.partial" / "rest_low.ply").write_bytes(b"half")
            (folder / ".README.1.partial.md").write_text("half")
            raise KeyboardInterrupt
        return original(source, folder, subject=subject, **options)

    monkeypatch.setattr(module, "build_subject", killed)
    with pytest.raises(KeyboardInterrupt):
        build(Balls(), out, options=OPTIONS, workers=1)
    with pytest.raises(InputError, match="not a finished DeFAUST folder.*same defaust build again"):
        read_dataset(out)
    kept = lambda *args, **kw: built.append(kw["subject"]) or original(*args, **kw)  # noqa: E731
    monkeypatch.setattr(module, "build_subject", kept)
    build(Balls(), out, options=OPTIONS, workers=1, progress=lambda *step: built.append(step[1:3]))
    assert built == [(1, 3), 1, (2, 3), 2, (3, 3)] and contents(out) == contents(finished)


@pytest.mark.parametrize(
    "damage",
    [lambda out: flip_a_byte(out / "subject_00/rest.ply"), lambda out: (out / "README.md").unlink()],
    ids=["a byte", "the card"],
)
def test_a_rerun_restores_what_is_missing(finished, dataset, damage):
    damage(dataset)
    assert verify(dataset)
    build(Balls(), dataset, options=OPTIONS, workers=1)
    assert contents(dataset) == contents(finished)


@pytest.mark.parametrize(
    ("source", "options", "message"),
    [
        (Balls(), replace(OPTIONS, subjects=(0, 1)), r"build.subjects was \[0, 1, 2\] and is now \[0, 1\]"),
        (Balls(stretch=1.5), OPTIONS, "source.stretch was 1.0 and is now 1.5"),
    ],
)
def test_another_configuration_is_refused(dataset, source, options, message):
    before = contents(dataset)
    with pytest.raises(InputError, match=message):
        build(source, dataset, options=options, workers=1)
    assert contents(dataset) == before
    assert _difference({"a": {"b": 1}}, {"a": {}}) == "a.b was 1 and is now None"
    # The same holds for an unfinished build.
    (dataset / ".build").mkdir()
    (dataset / ".build/subject_00.json").write_text(json.dumps(read_dataset(dataset)["subjects"][0]))
    (dataset / "dataset.json").rename(dataset / ".build/recipe.json")
    with pytest.raises(InputError, match=message):
        build(source, dataset, options=options, workers=1)


class Odd(Balls):
    """Balls: nothing moves in subject 0, subject 1 has no poses, and in subject 2 only the first moves."""

    def poses(self, subject):
        if subject == 1:
            raise InputError("subject 1 has none")
        return super().poses(subject)

    def posed(self, subject, pose):
        return self.rest(subject) if subject == 0 or pose.name == "turn" else super().posed(subject, pose)


def test_subjects_and_poses_that_cannot_be_used_are_refused_or_left_out_with_the_reason(tmp_path, caplog):
    out, still = tmp_path / "balls", "nothing moves in pose {}: each landmark moves less than 1 %"
    none, lean, turn = "subject 1 has none", still.format("lean"), still.format("turn")
    for subjects, strict, message in ((None, 1, none), ((1,), 0, none), ((0,), 0, lean), ((2,), 1, turn)):
        with pytest.raises(InputError, match=message):
            build(Odd(), out, options=replace(KEPT, subjects=subjects), workers=1, strict=bool(strict))
    caplog.clear()
    document = build(Odd(), out, options=replace(KEPT, subjects=(2, 1, 0, 2)), workers=1, strict=False)
    (subject,), without = document["subjects"], document["left_out"]
    assert [one["subject"] for one in (subject, *without)] == [2, 0, 1] and len(subject["poses"]) == 1
    card = (out / "README.md").read_text()
    for one, reason in zip(without + subject["left_out"], (f"subject 0: {lean}", none, turn), strict=True):
        assert one["reason"].startswith(reason) and one["reason"] in caplog.text and reason in card
    assert verify(out) == []


class Killed(Balls):
    """Balls whose process ends."""

    def rest(self, subject):
        if multiprocessing.parent_process() is not None:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().rest(subject)


def test_a_build_has_as_many_processes_as_it_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "ProcessPoolExecutor", begin := Mock(side_effect=InterruptedError))
    with pytest.raises(InterruptedError):
        build(Balls(), tmp_path / "balls", options=OPTIONS, workers=2)
    assert begin.call_args.args == (2,) and begin.call_args.kwargs.keys() == {"mp_context", "initializer"}


def test_a_killed_process_of_a_build_is_told(tmp_path):
    with pytest.raises(InputError, match="a process of the build was killed, perhaps for lack of memory"):
        build(Killed(), tmp_path / "balls", options=KEPT, workers=2)


@pytest.mark.full
def test_workers_end_with_a_killed_build(tmp_path):
    work = "from tests.defaust.toy import *; from defaust.build.dataset import build; "
    work += "build(Balls(subjects=(*range(500),)), Path('out'), options=OPTIONS, workers=2)"
    with subprocess.Popen([sys.executable, "-c", work], cwd=tmp_path) as process:
        while not list(tmp_path.glob("out/.build/subject_*.json")):
            assert process.poll() is None
            sleep(0.1)
        workers = psutil.Process(process.pid).children(recursive=True)
        process.kill()
    assert len(workers) >= 2
    _, alive = psutil.wait_procs(workers, timeout=30)
    for worker in alive:
        worker.kill()
    assert not alive


def test_a_changed_record_is_a_fault_and_is_not_read(dataset):
    change(dataset, lambda d: d["subjects"][0]["high"].update(volume=5.0), sign=False)
    assert [fault.text for fault in verify(dataset)] == ["its content does not match its own checksum"]
    for use in (read_dataset, lambda root: build(Balls(), root, options=OPTIONS)):
        with pytest.raises(InputError, match="changed after the build"):
            use(dataset)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda h: h[0]["target"].__setitem__(0, [0.0, 0.0, 0.0]), "a target is not its vertex"),
        (lambda h: h[0]["source"].__setitem__(2, [9.0, 9.0, 9.0]), "handle 2 is no vertex of rest_low.ply"),
        (lambda h: h[1]["source"].__setitem__(1, h[0]["source"][0]), "a vertex is a handle twice"),
        (lambda h: [h[0][k].__setitem__(1, h[0][k][0]) for k in ("source", "target")], "a handle twice"),
        (lambda h: [h[0][k].pop() for k in ("source", "target")], "has 5 handles, not 6"),
        (lambda h: h.reverse(), "its landmarks differ from those of the dataset"),
        (lambda h: h[0].update(delta=1.0), "delta is 1.0"),
        (lambda h: h[0].update(delta_mean=1.0), "delta_mean is 1.0"),
        (lambda h: h[1].update(kind="dynamic"), "listed as dynamic, and static when recomputed"),
    ],
)
def test_a_wrong_handle_is_found(dataset, edit, message):
    name = "subject_01/pose_1.json"
    change_handles(dataset, name, lambda content: edit(content["handles"]))
    (fault,) = verify(dataset)
    assert fault.file == name and message in fault.text


def test_a_file_is_not_held_in_memory_for_its_checksum(tmp_path):
    (tmp_path / "large").write_bytes(bytes(1 << 23))
    tracemalloc.start()
    sha256(tmp_path / "large")
    assert tracemalloc.get_traced_memory()[1] < 1 << 20
    tracemalloc.stop()


def test_a_value_that_does_not_fit_its_schema_is_named():
    for value, schema, problem in (
        (True, int, "it is True, not a whole number"),
        (True, float, "it is True, not a number"),
        ([1], [float, float], "it has 1 items, not 2"),
        ({"a": {"b": [1, "2"]}}, {"a": {str: [int]}}, "a.b[1] is '2', not a whole number"),
    ):
        assert mismatch(value, schema) == problem


def test_wrong_meshes_are_found(dataset):
    low = read_mesh(dataset / "subject_00/rest_low.ply")
    high = read_mesh(dataset / "subject_02/rest.ply")
    two = beside(high, shifted(high, 5))
    write_mesh(dataset / "subject_00/rest.ply", low.V, low.F)
    write_mesh(dataset / "subject_01/pose_1_low.ply", low.V, low.F[:, [1, 2, 0]])
    write_mesh(dataset / "subject_02/rest.ply", two.V, two.F)
    (dataset / "subject_02/pose_2.json").unlink()
    expected = {
        "subject_00/rest.ply": "number of vertices: 642, not ",
        "subject_01/pose_1_low.ply": "its faces differ from those of rest_low.ply",
        "subject_02/rest.ply": "number of components: 2, not 1",
    }
    for name in expected:
        relist(dataset, name)
    (dataset / "subject_02/pose_1_low.ply").write_bytes(b"damaged")
    (dataset / "README.md").unlink()
    expected |= {"subject_02/pose_1_low.ply": "its sha256 differs"}
    expected |= dict.fromkeys(["README.md", "subject_02/pose_2.json"], "missing")
    faults = dict(found := verify(dataset))
    assert faults.keys() == expected.keys() and len(found) == len(faults)
    assert all(text in faults[name] for name, text in expected.items())

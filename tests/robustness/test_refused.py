"""Damaged inputs, full disks, and names in other scripts: what is refused is not half written."""

import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from defaust.sources.synthetic import SyntheticBodies
from eval.rows.frame import read_csv, write_csv
from sshade import DeformationTask, Handles, deform
from sshade.core.threads import available_cpus
from sshade.files.meshes import read_arrays, write_mesh
from tests.files import contents
from tests.robustness.case import assert_refused, check_refusal, full_disk, run
from tests.robustness.inputs import BODY
from tests.robustness.working import RUN, cut, dataset, runs
from tests.shapes import bent, subdivided

REST = Path("balls/subject_00/rest.ply")


@pytest.mark.parametrize(
    ("damage", "words"), [(REST.unlink, "is missing; run the same"), (lambda: cut(REST), "not the file that")]
)
def test_a_damaged_dataset(here, damage, words):
    dataset()
    damage()
    assert_refused("sshade-eval", RUN, words)


def in_run(name: str) -> Path:
    """Return a file of the first run."""
    return min(Path("out/runs").rglob(name))


def of_another_function() -> None:
    rows = read_csv("out/rows/tiny.csv")
    write_csv("out/rows/tiny.csv", rows.assign(**{"task.source": '{"_target_": "os.getcwd"}'}))


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda: cut(in_run("vertices.npy")), "vertices.npy: not the file of a run"),
        (lambda: in_run("vertices.npy").write_bytes(pickle.dumps([1])), "not the file of a run"),
        (lambda: np.save(in_run("vertices.npy"), np.zeros((5, 3))), "5"),
        (lambda: shutil.rmtree("balls"), "balls"),
        (of_another_function, "and no task"),
    ],
)
def test_figures_of_a_damaged_run(here, damage, words):
    """Figures read the files and the source that a row names."""
    runs()
    damage()
    check_refusal(run("sshade-eval figures tiny"), words)


PRINTING = [sys.executable, "-m", "sshade", "--help"]


def test_names_in_other_scripts_and_with_blanks(sound):
    Path("Körper 体").mkdir()
    shutil.copy("body.ply", "Körper 体/模型 ü.ply")
    shutil.copy("pose.json", "поза 1.json")
    assert run("sshade deform 'Körper 体/模型 ü.ply' 'поза 1.json' -o 'Körper 体/out é.ply'")[0] == 0
    assert run("sshade deform body.ply pose.json -o out.ply")[0] == 0
    assert np.array_equal(read_arrays("Körper 体/out é.ply")[0], read_arrays("out.ply")[0])


@pytest.mark.parametrize(
    "command",
    [
        *(f"sshade deform body.ply pose.json -o out.{suffix}" for suffix in ("ply", "obj", "stl")),
        "sshade deform body.ply pose.json pose.json -o out.glb --vertices 60",
        "sshade remesh body.ply -o proxy.ply --map map.npz --vertices 40",
        "sshade show body.ply -o out.html",
        "sshade-eval collect tiny -o rows",
        "sshade-eval tables tiny -o t",
    ],
)
def test_on_a_full_disk_a_command_changes_no_file(sound, command):
    if command.startswith("sshade-eval"):
        runs()
    code, _, err = run(command)
    assert code == 0, err  # first with room, so that the machine code of kernels is stored
    before = contents()
    with full_disk(60):
        check_refusal(run(command), "cannot be written (File too large)")
    assert contents() == before


def test_a_run_on_a_full_disk_leaves_no_part_of_a_row_and_a_rerun_completes_it(here):
    runs()
    before, command = contents(), f"sshade-eval {RUN} run.experiment=tiny subject=1"
    with full_disk(3000):
        check_refusal(run(command), "cannot be written", "disk may be full")
    assert contents() == before
    # A row and the vertices of the method, and of the true pose.
    assert run(command)[0] == 0 and len(contents().keys() - before.keys()) == 4


def test_a_build_on_a_full_disk_leaves_its_recipe_and_a_rerun_completes_it(here):
    Path("meshes").mkdir()
    for k, name in enumerate(("a0", "a1", "b0", "b1")):
        write_mesh(f"meshes/{name}.ply", bent(BODY.V, 0.1 * k), BODY.F)
    command = "defaust build source=sequence source.root=meshes out=out source.landmarks=3 workers=1"
    command += " handles_per_landmark=5 neighbourhood=10"
    assert run(command)[0] == 0
    shutil.rmtree("out")
    with full_disk(3000):
        check_refusal(run(command), "cannot be written (File too large)")
    assert list(contents("out")) == [".build/recipe.json"]
    assert run(command)[0] == 0 and run("defaust verify out")[0] == 0


def test_a_full_device_is_told():
    with open("/dev/full", "w") as full:
        done = subprocess.run(PRINTING, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
    assert done.returncode == 2 and done.stderr == "error: No space left on device\n", done


def test_a_reader_that_closes_its_pipe_ends_the_command_silently():
    with subprocess.Popen(PRINTING, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        assert process.stderr.read() == "" and process.wait(60) == 141


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity") or available_cpus() < 2, reason="takes two cores")
def test_the_same_bits_on_one_core_as_on_several():
    """Threads share the work on a body of 27,554 vertices."""
    source = SyntheticBodies()
    rest, posed = (subdivided(mesh) for mesh in (source.rest(0), source.posed(0, source.poses(0)[0])))
    marks = rest.V[list(source.landmark_vertices(0).values())]
    index = np.unique([np.argsort(((rest.V - mark) ** 2).sum(axis=1))[:10] for mark in marks])
    task = DeformationTask("body", rest, Handles(index, posed.V[index]))
    all_cores = os.sched_getaffinity(0)
    several = deform(task, method="fine", polish_iterations=5).vertices
    os.sched_setaffinity(0, {min(all_cores)})
    try:
        one = deform(task, method="fine", polish_iterations=5).vertices
    finally:
        os.sched_setaffinity(0, all_cores)
    assert np.array_equal(one, several)

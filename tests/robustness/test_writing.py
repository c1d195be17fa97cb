"""Outputs on a full disk, to a device that is full, and under names in other scripts."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sshade.files.meshes import read_arrays, write_mesh
from tests.files import contents
from tests.robustness.case import check_refusal, full_disk, run
from tests.robustness.inputs import BODY
from tests.robustness.working import RUN, runs
from tests.shapes import bent

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

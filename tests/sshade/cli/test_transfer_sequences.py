"""Sequences of ``sshade transfer-pose``, onto an edited copy and through marks onto another mesh."""

import json
from pathlib import Path

import numpy as np
import pytest

from defaust.tasks.motions import spread
from sshade.cli.main import main
from sshade.io.meshes import read_arrays, write_mesh
from tests.robustness.case import assert_refused
from tests.shapes import bent, bumpy
from tests.sshade.cli.test_sequences import (
    interrupted_at_the_third_file,
    read_gltf,
    read_pc2,
    shown_at,
    vertices,
)

BODY, OTHER = bumpy(2), bumpy(3)
AMOUNTS = (0.05, 0.1, 0.15)
SMALL = ["--vertices", "60", "--samplings", "2"]


@pytest.fixture
def folder(here) -> Path:
    """A body in three poses, an edited copy, another mesh of the same shape, and marks on both."""
    write_mesh("rest.ply", BODY.V, BODY.F)
    write_mesh("edited.ply", BODY.V * [1.0, 1.1, 1.0], BODY.F)
    write_mesh("other.ply", OTHER.V, OTHER.F)
    Path("poses").mkdir()
    for number, amount in enumerate(AMOUNTS):
        write_mesh(f"poses/walk_{number}.ply", bent(BODY.V, amount), BODY.F)
    for name in ("readme.txt", "._walk_0.ply"):
        Path("poses", name).write_text("no mesh")
    marks = [{"source": int(i), "target": BODY.V[i].tolist()} for i in spread(BODY.V, 40)]
    Path("marks.json").write_text(json.dumps({"marks": marks}))
    return here


def test_a_folder_of_poses_moves_an_edited_copy_as_single_transfers_do(folder):
    for output in ("out_%d.ply", "out.glb", "out.pc2"):
        assert main(["transfer-pose", "rest.ply", "poses", "edited.ply", "-o", output, *SMALL]) == 0
    for number, V in enumerate(vertices("out_?.ply")):
        single = ["transfer-pose", "rest.ply", f"poses/walk_{number}.ply", "edited.ply", "-o", "single.ply"]
        assert main([*single, *SMALL]) == 0
        np.testing.assert_array_equal(V, read_arrays("single.ply")[0])
    np.testing.assert_allclose(read_pc2("out.pc2"), vertices("out_?.ply"), atol=1e-6)
    shown = shown_at(*read_gltf("out.glb"), 0, "POSITION")
    np.testing.assert_allclose(shown, vertices("out_?.ply"), atol=1e-6)


def test_the_output_has_the_contents_of_the_edited_shape_and_numbers_are_in_order(folder):
    write_mesh("edited.obj", BODY.V * [1.0, 1.1, 1.0], BODY.F)
    Path("edited.obj").write_text("o edited\n" + Path("edited.obj").read_text())
    Path("poses/walk_2.ply").rename("poses/walk_10.ply")
    Path("poses/walk_1.ply").rename("poses/walk_9.ply")
    assert main(["transfer-pose", "rest.ply", "poses", "edited.obj", "-o", "out_%02d.obj", *SMALL]) == 0
    assert main(["transfer-pose", "rest.ply", "poses/walk_9.ply", "edited.obj", "-o", "one.obj", *SMALL]) == 0
    assert Path("out_02.obj").read_bytes() == Path("one.obj").read_bytes()
    assert Path("one.obj").read_text().startswith("o edited\n")


def test_poses_drive_another_mesh_through_marks(folder):
    command = ["transfer-pose", "rest.ply", "poses", "other.ply", "--marks", "marks.json"]
    assert main([*command, "-o", "out_%d.ply"]) == 0
    for amount, V in zip(AMOUNTS, vertices("out_?.ply"), strict=True):
        truth = bent(OTHER.V, amount)
        error = np.linalg.norm(V - truth - (V - truth).mean(axis=0), axis=1)
        still = np.linalg.norm(OTHER.V - truth - (OTHER.V - truth).mean(axis=0), axis=1)
        assert error.mean() < 0.2 * still.mean()
    files = ["poses/walk_0.ply", "poses/walk_1.ply", "poses/walk_2.ply"]
    assert main([*command[:2], *files, *command[3:], "-o", "files_%d.ply"]) == 0
    np.testing.assert_array_equal(vertices("files_?.ply"), vertices("out_?.ply"))
    assert main([*command[:2], files[0], *command[3:], "-o", "one.ply"]) == 0
    np.testing.assert_array_equal(read_arrays("one.ply")[0], vertices("out_1.ply")[0])


def test_an_interrupted_retargeting_goes_on_to_the_same_bytes(folder, monkeypatch, capsys):
    command = ["transfer-pose", "rest.ply", "poses", "other.ply", "--marks", "marks.json", "-o"]
    assert main([*command, "out_%d.ply"]) == 0
    count = interrupted_at_the_third_file(monkeypatch)
    assert main([*command, "parts_%d.ply"]) == 130
    assert main([*command, "parts_%d.ply"]) == 0
    assert len(count) == 4
    for number in (1, 2, 3):
        assert Path(f"out_{number}.ply").read_bytes() == Path(f"parts_{number}.ply").read_bytes()
    assert "2 of them kept" in capsys.readouterr().err


def few_marks() -> None:
    Path("marks.json").write_text(json.dumps({"marks": [{"source": 1, "target": 1}]}))


def mark(**given) -> None:
    data = json.loads(Path("marks.json").read_text())
    data["marks"][3] |= given
    Path("marks.json").write_text(json.dumps(data))


def longer_pose() -> None:
    write_mesh("poses/walk_1.ply", OTHER.V, OTHER.F)


def no_poses() -> None:
    for path in Path("poses").glob("*.ply"):
        path.unlink()


MARKS = ["poses", "other.ply", "--marks", "marks.json", "-o", "out_%d.ply"]
ONE = ["other.ply", "-o", "out.ply"]
BAD = {
    "folder": (no_poses, MARKS, "poses: the folder has no mesh files"),
    "other counts": (longer_pose, MARKS, "poses/walk_1.ply has 642 vertices and rest.ply has 162"),
    "edited of other counts": (
        None,
        ["poses", "other.ply", "-o", "out_%d.ply"],
        "other.ply has 642 vertices and rest.ply has 162; they must correspond",
    ),
    "few marks": (few_marks, MARKS, "marks.json: 1 marks are given, and at least 4 are needed"),
    "far mark": (lambda: mark(target=[99.0, 0, 0]), MARKS, "the marks: mark 3 is 98"),
    "id out of range": (lambda: mark(source=162), MARKS, 'mark 3: the "source" 162 is not in 0..161'),
    "no place": (lambda: mark(source="nose"), MARKS, 'mark 3: "source" must be the id of a vertex'),
    "unknown key": (lambda: mark(weight=1), MARKS, 'mark 3: there is no key "weight"'),
    "no list": (lambda: Path("marks.json").write_text("[]"), MARKS, 'expected an object with a list "marks"'),
    "no json": (lambda: Path("marks.json").write_text("{"), MARKS, "marks.json: not readable as JSON"),
    "marks as output": (
        lambda: Path("marks.json").rename("out_sequence.json"),
        ["poses", "other.ply", "--marks", "out_sequence.json", "-o", "out_%d.ply"],
        "out_sequence.json: is the input out_sequence.json; give another name",
    ),
    "sampling": (None, [*MARKS, "--samplings", "3"], "--samplings does not apply with --marks"),
    "fps": (None, ["poses/walk_1.ply", *ONE, "--fps", "9"], "--fps applies to sequences"),
    "fps with marks": (
        None,
        ["poses/walk_1.ply", *ONE, "--marks", "marks.json", "--fps", "9"],
        "--fps applies to sequences",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_refused_in_a_sentence_before_anything_is_written(folder, name):
    given, arguments, words = BAD[name]
    if given is not None:
        given()
    assert_refused("sshade", ["transfer-pose", "rest.ply", *arguments], words)

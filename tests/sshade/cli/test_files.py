"""The commands write a copy of the file that they read, also of meshes that move along."""

from pathlib import Path

import numpy as np
import pytest

from sshade import Mesh, move_along
from sshade.cli.main import main
from sshade.files.meshes import read_arrays, read_file, read_mesh, write_mesh
from tests.robustness.case import run
from tests.robustness.inputs import BODY
from tests.shapes import as_obj, bent, torn
from tests.write import rows

pytestmark = pytest.mark.usefixtures("sound")

V, F, _ = torn(BODY)


def test_remesh_carry_and_transfers_keep_the_file_too():
    own, faces = V[1:], F - 1  # without the unused vertex, which these commands refuse
    Path("seam.obj").write_text(as_obj(own, faces))
    assert main(["remesh", "seam.obj", "-o", "proxy.ply", "--map", "m.npz", "--vertices", "40"]) == 0
    proxy = read_mesh("proxy.ply")
    write_mesh("edited.ply", proxy.V + [1, 2, 3], proxy.F)
    assert main(["carry", "seam.obj", "m.npz", "edited.ply", "-o", "out.obj"]) == 0
    moved, same = read_arrays("out.obj")
    assert np.allclose(moved, own + [1, 2, 3], rtol=0, atol=1e-12) and np.array_equal(same, faces)
    Path("body.obj").write_text(as_obj(BODY.V, BODY.F))
    posed = BODY.V[:, [1, 2, 0]]
    write_mesh("posed.ply", posed, BODY.F)
    assert main(["reconstruct", "body.obj", "posed.ply", "-o", "posed.obj", "--samplings", "1"]) == 0
    assert np.abs(read_arrays("posed.obj")[0] - posed).max() < 0.1 * BODY.diagonal
    line = ["transfer-pose", "body.ply", "posed.ply", "body.obj", "-o", "edited.obj", "--samplings", "1"]
    assert main(line) == 0  # the output has the contents of the edited shape
    for source, result in (("seam.obj", "out.obj"), ("body.obj", "posed.obj"), ("body.obj", "edited.obj")):
        old, new = (Path(name).read_text().partition("vt ")[2] for name in (source, result))
        assert old == new


def test_a_transfer_with_residual_gives_the_pose_back_to_its_own_shape():
    write_mesh("wavy.ply", BODY.V + 0.2 * np.sin(3 * BODY.V[:, [1, 2, 0]]), BODY.F)
    far = []
    for switch in ([], ["--residual"]):
        line = ["transfer-pose", "body.ply", "wavy.ply", "body.ply", "-o", "t.ply", "--vertices", "40"]
        assert main([*line, "--overwrite", *switch]) == 0
        far.append(np.abs(read_arrays("t.ply")[0] - read_arrays("wavy.ply")[0]).max() / BODY.diagonal)
    assert far[0] > 1e-3 and far[1] < 1e-6


def test_a_transfer_notices_a_pose_in_the_place_of_the_edit(capsys):
    write_mesh("bent.ply", bent(BODY.V), BODY.F)
    write_mesh("edited.ply", BODY.V * [1.02, 1, 1] + [9, 0, 0], BODY.F)  # also moved, which is no pose
    for shapes, noticed in ((["bent.ply", "edited.ply"], False), (["edited.ply", "bent.ply"], True)):
        line = ["transfer-pose", "body.ply", *shapes, "-o", "t.ply", "--vertices", "40", "--samplings", "1"]
        assert main(line) == 0
        told = "note: bent.ply is farther from body.ply than edited.ply; the pose comes first"
        assert (told in capsys.readouterr().err) is noticed


CALL = "sshade deform body.ply pose.json -o posed.ply --with {}"


def shirt() -> Mesh:
    middle = BODY.V.mean(axis=0)
    return Mesh(middle + 1.05 * (BODY.V - middle), BODY.F)


def test_a_shirt_keeps_its_texture_and_turns_its_normals(tmp_path):
    mesh = shirt()
    faces = [f"f {a}/1/{i} {b}/1/{i} {c}/1/{i}" for i, (a, b, c) in enumerate((mesh.F + 1).tolist(), 1)]
    head = ["mtllib shirt.mtl", "usemtl cloth", "vt 0.1 0.2"]
    text = "\n".join([*head, *rows("v ", mesh.V), *rows("vn ", mesh.face_normals), *faces, ""])
    (tmp_path / "shirt.obj").write_text(text)
    write_mesh("hair.glb", mesh.V, mesh.F)
    code, _, said = run(CALL.format("shirt.obj hair.glb"))
    assert code == 0 and "away from the mesh" not in said
    assert "posed_shirt.obj: 162 vertices of shirt.obj" in said
    want = move_along(BODY, read_mesh("posed.ply").V, mesh.V)
    posed = read_file("posed_shirt.obj")
    assert pytest.approx(want, abs=1e-6) == posed.V
    assert pytest.approx(want, abs=1e-6) == read_file("posed_hair.glb").V
    lines = (tmp_path / "posed_shirt.obj").read_text().splitlines()
    assert lines[:3] == head
    normals = np.array([line.split()[1:] for line in lines if line.startswith("vn ")], dtype=float)
    number = [int(line.split()[1].split("/")[2]) - 1 for line in lines if line.startswith("f ")]
    assert (normals[number] * Mesh(posed.V, mesh.F).face_normals).sum(axis=1).min() > 0.9
    written = {path.name for path in tmp_path.glob("*posed*")}
    assert written == {"posed.ply", "posed_hair.glb", "posed_shirt.obj"}


@pytest.mark.parametrize("shift", [[0.4, 0, 0], [0, 0, -0.3]])
def test_clothes_beside_the_body_are_named_with_their_distance(shift):
    """They lie outside of the box of the body, but near enough to move along."""
    mesh = shirt()
    write_mesh("on.obj", mesh.V, mesh.F)
    write_mesh("off.ply", mesh.V + BODY.diagonal * np.array(shift), mesh.F)
    code, _, said = run(CALL.format("on.obj off.ply"))
    (note,) = (line for line in said.splitlines() if "away from the mesh" in line)
    assert code == 0 and note.startswith("note: off.ply: its vertices are up to ")
    found = float(note.partition("up to ")[2].partition(" %")[0])
    gaps = (mesh.V[:, None] + BODY.diagonal * np.array(shift)) - BODY.V
    true = np.linalg.norm(gaps, axis=2).min(axis=1).max()
    assert 0.7 * true <= found / 100 * BODY.diagonal <= true

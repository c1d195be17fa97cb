"""``sshade deform --with``: other meshes move along with the mesh and are written with all they hold."""

import numpy as np
import pytest

from sshade import Mesh, move_along
from sshade.files.meshes import read_file, read_mesh, write_mesh
from tests.robustness.case import run
from tests.robustness.inputs import BODY
from tests.write import rows

CALL = "sshade deform body.ply pose.json -o posed.ply --with {}"


pytestmark = pytest.mark.usefixtures("sound")


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

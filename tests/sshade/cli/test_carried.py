"""``sshade deform --with``: files are carried with the mesh and written with all they hold."""

import numpy as np
import pytest

from sshade import Mesh, bind_points
from sshade.io.meshes import read_file, read_mesh, write_mesh
from sshade.io.splats import read_points
from tests.robustness.case import run
from tests.robustness.inputs import BODY
from tests.sshade.io.test_splats import write_splats
from tests.write import lines, rows

CALL = "sshade deform body.ply pose.json -o posed.ply --with {}"


pytestmark = pytest.mark.usefixtures("sound")


def shirt() -> Mesh:
    middle = BODY.V.mean(axis=0)
    return Mesh(middle + 1.05 * (BODY.V - middle), BODY.F)


def test_a_shirt_keeps_its_texture_and_turns_its_normals(tmp_path):
    mesh = shirt()
    normals = rows("vn ", mesh.face_normals)
    faces = [f"f {a}/1/{i} {b}/1/{i} {c}/1/{i}" for i, (a, b, c) in enumerate((mesh.F + 1).tolist(), 1)]
    head = ["mtllib shirt.mtl", "usemtl cloth", "vt 0.1 0.2"]
    (tmp_path / "shirt.obj").write_bytes(lines(head, rows("v ", mesh.V), normals, faces))
    write_mesh("hair.glb", mesh.V, mesh.F)
    code, _, said = run(CALL.format("shirt.obj hair.glb"))
    assert code == 0 and "posed_shirt.obj: 162 points of shirt.obj" in said
    posed = read_mesh("posed.ply")
    want = bind_points(BODY, mesh.V)(posed.V)
    assert pytest.approx(want, abs=1e-6) == read_file("posed_shirt.obj").V
    assert pytest.approx(want, abs=1e-6) == read_file("posed_hair.glb").V
    text = (tmp_path / "posed_shirt.obj").read_text()
    assert "usemtl cloth" in text and "vt 0.1 0.2" in text and "mtllib shirt.mtl" in text
    assert sorted(path.name for path in tmp_path.iterdir() if "posed" in path.name) == [
        "posed.ply",
        "posed_hair.glb",
        "posed_shirt.obj",
    ]


def test_splats_and_points_follow_the_map(tmp_path):
    old = write_splats(tmp_path / "scene.ply", shirt().V)
    write_splats(tmp_path / "cloud.ply", shirt().V, properties=["x", "y", "z", "nx", "ny", "nz", "red"])
    code, _, said = run(CALL.format("scene.ply cloud.ply"))
    assert code == 0 and "162 splats of scene.ply" in said and "162 points of cloud.ply" in said
    found = bind_points(BODY, old[:, :3]).with_maps(read_mesh("posed.ply").V)
    new = read_points(tmp_path / "posed_scene.ply")
    assert pytest.approx(found.positions, abs=1e-6) == new.V
    columns = new.ply.elements["vertex"].columns(list(range(3, 6)))
    assert columns == pytest.approx(np.einsum("nij,nj->ni", found.rotations, old[:, 3:6]), abs=1e-5)
    assert (tmp_path / "scene.ply").stat().st_size == (tmp_path / "posed_scene.ply").stat().st_size


@pytest.mark.parametrize("order", ["", "<"])
def test_a_file_without_points_stays_as_it_is(tmp_path, order):
    write_splats(tmp_path / "none.ply", np.empty((0, 3)), properties=["x", "y", "z"], order=order)
    code, _, said = run(CALL.format("none.ply"))
    assert code == 0 and "0 points of none.ply" in said
    assert (tmp_path / "posed_none.ply").read_bytes() == (tmp_path / "none.ply").read_bytes()

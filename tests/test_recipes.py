"""docs/python.md: the code for other libraries runs as it stands, and makes the shape that arrays make."""

import re
from pathlib import Path

import meshio
import numpy as np
import pytest

import sshade
from sshade.files.meshes import read_file, write_mesh
from tests.shapes import bumpy

PAGE = (Path(__file__).parents[1] / "docs" / "python.md").read_text(encoding="utf-8")
FIRST, *PARTS = re.split(r"^### (.+)$", PAGE.split("\n## Other libraries\n")[1], flags=re.M)
SECTIONS = dict(zip(PARTS[::2], PARTS[1::2], strict=True))
BODY = bumpy(3)


def code(text: str) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", text, re.M | re.S)


@pytest.fixture
def run(here):
    """Run the blocks of a section after the first block of all recipes; return the names that they define."""
    write_mesh("body.ply", BODY.V[:, [1, 2, 0]], BODY.F)  # upright

    def run(section: str, *, blocks: int) -> dict:
        names: dict = {}
        found = code(SECTIONS[section])
        assert len(found) == blocks
        for block in [*code(FIRST), *found]:
            exec(compile(block, f"python.md, {section}", "exec"), names)
        names["expected"] = sshade.deform(*sshade.read("body.ply"), names["b"], names["bc"])
        assert np.abs(names["expected"] - names["V"]).max() > 0.1  # it moves
        return names

    return run


def same(V: np.ndarray, expected: np.ndarray, *, atol: float = 1e-9) -> bool:
    return V.shape == expected.shape and bool(np.allclose(V, expected, atol=atol))


def test_every_section_has_a_test():
    functions = {name.removeprefix("test_recipe_").lower() for name in globals()}
    assert {name.lower() for name in SECTIONS} <= functions


def test_recipe_trimesh(run):
    names = run("trimesh", blocks=2)
    for shown in ("posed", "mesh"):
        assert same(names[shown].vertices, names["expected"])
    assert same(sshade.read("posed.glb").V, names["expected"], atol=1e-6)  # float32


def test_recipe_pyvista(run):
    names = run("pyvista", blocks=2)
    # VTK reads positions as float32, which moves iterations a little.
    assert same(names["posed"].points, names["expected"], atol=1e-4)
    assert same(names["mesh"].points, names["expected"], atol=1e-3)  # a drag ends in the same minimum
    assert same(names["posed"]["moved"], np.linalg.norm(names["expected"] - names["V"], axis=1), atol=1e-4)
    assert Path("posed.vtp").stat().st_size > 1000


def test_recipe_polyscope(run, monkeypatch):
    polyscope = pytest.importorskip("polyscope", exc_type=ImportError)
    begin, moved, callbacks = polyscope.init, [], []
    monkeypatch.setattr(polyscope, "init", lambda: begin("openGL_mock"))  # it needs no screen
    monkeypatch.setattr(polyscope, "set_user_callback", callbacks.append)
    monkeypatch.setattr(polyscope.imgui, "SliderFloat", lambda *_: (True, 1.0))
    monkeypatch.setattr(polyscope.SurfaceMesh, "update_vertex_positions", lambda self, V: moved.append(V))
    monkeypatch.setattr(polyscope, "show", lambda: callbacks[0]())
    names = run("polyscope", blocks=1)
    assert names["shown"].n_vertices() == BODY.n and same(moved[0], names["expected"], atol=1e-3)
    polyscope.shutdown()  # writes its files to the folder of the test


def test_recipe_open3d(run):
    pytest.importorskip("open3d", exc_type=ImportError)
    names = run("Open3D", blocks=2)
    assert same(names["U"], names["expected"]) and same(sshade.read("posed.ply").V, names["expected"])
    # The points of the posed surface came to the surface at rest.
    centres = names["V"][names["F"]].mean(axis=1)
    distance = np.linalg.norm(np.asarray(names["cloud"].points)[:, None] - centres, axis=2).min(axis=1)
    assert len(distance) == 1000 and distance.max() < sshade.Mesh(names["V"], names["F"]).mean_edge


def test_recipe_meshlab(run):
    names = run("MeshLab", blocks=2)
    assert same(read_file("posed.ply").V, names["expected"]) and same(names["U"], names["expected"])
    assert same(sshade.read("posed.obj").V, names["expected"], atol=1e-5)  # MeshLab writes few digits
    assert names["fixed"].tolist() == np.flatnonzero(names["height"] < 0.05).tolist()
    assert same(names["mesh"].vertex_matrix(), names["V"])


def test_recipe_libigl(run):
    names = run("libigl", blocks=1)
    assert same(names["U"], names["expected"])
    assert same(sshade.read("posed.obj").V, names["expected"], atol=1e-5)


def test_recipe_meshio(run):
    names = run("meshio", blocks=1)
    assert same(names["file"].points, names["expected"])
    assert same(meshio.read("posed.vtu").points, names["expected"])

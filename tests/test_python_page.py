"""The code of docs/python.md and of the notebook runs as it stands, and makes the shape that arrays make."""

import ast
import json
import re
from operator import attrgetter
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

import sshade
from sshade.files.meshes import read_file, write_mesh
from sshade.files.task_files import write_handles
from tests.shapes import bumpy, end_handles

DOCS = Path(__file__).parents[1] / "docs"
PAGE = (DOCS / "python.md").read_text(encoding="utf-8")
FIRST, *PARTS = re.split(r"^### (.+)$", PAGE.split("\n## Other libraries\n")[1], flags=re.M)
SECTIONS = dict(zip(PARTS[::2], PARTS[1::2], strict=True))
NOTEBOOK = DOCS / "examples" / "deform.ipynb"
BODY = bumpy(3)
#: Where the code for a library leaves the deformed shape, by section: names or files, and the error of each.
#: VTK reads positions as float32, glTF stores them so, MeshLab and libigl write few digits, and a drag ends
#: near the minimum.
SHAPES = {
    "trimesh": {"posed.vertices": 1e-9, "mesh.vertices": 1e-9, "posed.glb": 1e-6},
    "pyvista": {"posed.points": 1e-4, "mesh.points": 1e-3},
    "polyscope": {"moved": 1e-3},
    "Open3D": {"U": 1e-9, "posed.ply": 1e-9},
    "MeshLab": {"posed.ply": 1e-9},
    "libigl": {"U": 1e-9, "posed.obj": 1e-5},
    "meshio": {"file.points": 1e-9, "posed.vtu": 1e-9},
}
#: How a file is read; other files are read by `sshade.read`.
READERS = {".ply": lambda path: read_file(path).V, ".vtu": lambda path: meshio.read(path).points}


def code(text: str) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", text, re.M | re.S)


def run(source: str, names: dict[str, Any]) -> Any:
    """Execute a cell; return the value of its last line if that is an expression."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)
    return last and eval(compile(ast.Expression(last.value), "cell", "eval"), names)


def without_a_screen(monkeypatch, names: dict[str, Any]) -> None:
    """Let polyscope run its callback once, with its slider at the end; keep the positions that it shows."""
    polyscope = pytest.importorskip("polyscope", exc_type=ImportError)
    begin, callbacks = polyscope.init, []
    monkeypatch.setattr(polyscope, "init", lambda: begin("openGL_mock"))
    monkeypatch.setattr(polyscope, "set_user_callback", callbacks.append)
    monkeypatch.setattr(polyscope.imgui, "SliderFloat", lambda *_: (True, 1.0))
    update = "update_vertex_positions"
    monkeypatch.setattr(polyscope.SurfaceMesh, update, lambda self, V: names.update(moved=V))
    monkeypatch.setattr(polyscope, "show", lambda: [callbacks[0](), polyscope.shutdown()])


@pytest.mark.parametrize("section", SECTIONS)
def test_the_code_for_a_library_makes_the_shape_that_arrays_make(section, here, monkeypatch):
    write_mesh("body.ply", BODY.V[:, [1, 2, 0]], BODY.F)  # upright
    names: dict[str, Any] = {}
    if section == "polyscope":
        without_a_screen(monkeypatch, names)
    if section == "Open3D":
        pytest.importorskip("open3d", exc_type=ImportError)
    for block in [*code(FIRST), *code(SECTIONS[section])]:
        run(block, names)
    expected = sshade.deform(*sshade.read("body.ply"), names["b"], names["bc"])
    assert np.abs(expected - names["V"]).max() > 0.1  # it moves
    for place, error in SHAPES[section].items():
        name, _, attribute = place.partition(".")
        if Path(place).is_file():
            found = READERS.get(Path(place).suffix, lambda path: sshade.read(path).V)(place)
        else:
            found = attrgetter(attribute)(names[name]) if attribute else names[name]
        np.testing.assert_allclose(found, expected, atol=error, err_msg=place)


def test_the_code_for_notebooks_runs(here):
    blocks = code(PAGE.split("\n## Notebooks\n")[1].split("\n## ")[0])
    mesh = bumpy(2)
    task = sshade.DeformationTask("bend", mesh, end_handles(mesh.V, shift=(0.3, 0, 0.2)))
    write_handles("body_handles.json", task.handles)
    names = {"mesh": mesh, "task": task, "handles": task.handles, "V": mesh.V, "F": mesh.F, "U": 2 * mesh.V}
    for block in blocks:
        run(block, names)
    assert len(blocks) >= 4 and (here / "figure.html").exists()


def test_the_cells_of_the_notebook_have_no_outputs_run_and_show_figures(here):
    assert NOTEBOOK.stat().st_size < 6000
    text = NOTEBOOK.read_text(encoding="utf-8").replace("subdivisions=1", "subdivisions=0")  # a smaller body
    cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)
    names: dict[str, Any] = {}
    values = [run("".join(cell["source"]), names) for cell in cells]
    kinds = ["Mesh", "DeformationTask", "DeformationResult", "Figure", "Figure", "NoneType"]
    assert [type(value).__name__ for value in values] == kinds
    assert all("<iframe" in value._repr_html_() for value in values[:-1])
    assert (here / "distance.html").stat().st_size > 200_000 and names["distance"].mean() < 5

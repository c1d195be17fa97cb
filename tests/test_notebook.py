"""docs/examples/deform.ipynb and the cells of docs/python.md run, and their last lines show themselves."""

import ast
import json
import re
from pathlib import Path

import sshade
from sshade.files.task_files import write_handles
from tests.shapes import bumpy, end_handles

ROOT = Path(__file__).parents[1]
NOTEBOOK = ROOT / "docs" / "examples" / "deform.ipynb"
TEXT = NOTEBOOK.read_text(encoding="utf-8").replace("subdivisions=1", "subdivisions=0")  # a smaller body
CELLS = [cell for cell in json.loads(TEXT)["cells"] if cell["cell_type"] == "code"]


def run(source: str, names: dict):
    """Execute a cell; return the value of its last line if that is an expression."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)
    return last and eval(compile(ast.Expression(last.value), "cell", "eval"), names)


def test_the_notebook_is_small_and_has_no_outputs():
    assert NOTEBOOK.stat().st_size < 6000 and "subdivisions=0" in TEXT
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in CELLS)


def test_the_cells_run_and_show_figures(here):
    names: dict = {}
    values = [run("".join(cell["source"]), names) for cell in CELLS]
    assert [type(value).__name__ for value in values] == [
        *("Mesh", "DeformationTask", "DeformationResult", "Figure", "Figure", "NoneType")
    ]
    shown = [value._repr_html_() for value in values[:-1]]
    assert all("<iframe" in text and len(text) < 1_500_000 for text in shown)
    assert (here / "distance.html").stat().st_size > 200_000
    assert names["distance"].mean() < 5


def test_the_code_of_the_page_runs(here):
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    part = page.split("\n## Notebooks\n")[1].split("\n## ")[0]
    blocks = re.findall(r"^```python\n(.*?)^```", part, re.M | re.S)
    mesh = bumpy(2)
    task = sshade.DeformationTask("bend", mesh, end_handles(mesh.V, shift=(0.3, 0, 0.2)))
    write_handles("body_handles.json", task.handles)
    names = {"mesh": mesh, "task": task, "handles": task.handles, "V": mesh.V, "F": mesh.F, "U": 2 * mesh.V}
    for block in blocks:
        run(block, names)
    assert len(blocks) >= 4 and (here / "figure.html").exists()

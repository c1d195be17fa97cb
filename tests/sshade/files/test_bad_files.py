"""Files of libraries that hold no mesh, or another one than they announce, are refused in one sentence."""

from functools import partial
from pathlib import Path

import pytest
import pyvista

from sshade.files.meshes import write_mesh
from tests.files import contents
from tests.robustness.case import check_refusal, run
from tests.robustness.working import cut
from tests.shapes import bumpy

V, F = bumpy(2).V, bumpy(2).F
FORMATS = (".vtp", ".vtu", ".vtk", ".3mf", ".dae")


def cut_mesh(suffix: str) -> None:
    write_mesh(f"mesh{suffix}", V, F)
    cut(f"mesh{suffix}")


def web_page(suffix: str) -> None:
    Path(f"mesh{suffix}").write_text("<!DOCTYPE html>")


def line_cells() -> None:
    pyvista.UnstructuredGrid([2, 0, 1], [pyvista.CellType.LINE], V[:2]).save("mesh.vtu")


#: Suffix, a function that writes the file, and words of the refusal.
BAD = {
    f"{how.__name__} {end}": (end, partial(how, end), f"not a readable {end[1:].upper()} file (")
    for end in FORMATS
    for how in (cut_mesh, web_page)
}
BAD |= {
    "VTU without a surface": (".vtu", line_cells, "the file holds no triangles; give a mesh with faces"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_refusal_is_one_sentence_and_nothing_is_written(here, name, capfd):
    suffix, write, words = BAD[name]
    Path("pose.json").write_text('{"handles": [{"vertices": [0]}]}')
    write()
    capfd.readouterr()
    before = contents()
    check_refusal(run(f"sshade deform mesh{suffix} pose.json -o out.ply"), f"mesh{suffix}", words)
    assert contents() == before and capfd.readouterr() == ("", "")

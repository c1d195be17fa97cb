"""Files that hold no mesh, or another one than they announce, are refused in one sentence; one table."""

import gzip
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import pyvista

from sshade.files.meshes import write_mesh
from tests.files import contents
from tests.gltf import with_arrays
from tests.robustness.case import check_refusal, run
from tests.shapes import bumpy
from tests.write import lines, mesh_ply, obj, off, rows

BODY = bumpy(2)
V, F = BODY.V, BODY.F
#: A web page in place of each format, and words of the refusal.
PAGES = {
    ".ply": "not a readable PLY file (it does not begin with ply)",
    ".obj": "no triangles",
    ".off": "not a readable OFF file (it does not begin with OFF",
    ".stl": "not a readable STL file (it is neither a text that begins with solid",
    **{end: f"not a readable {end[1:].upper()} file (" for end in (".glb", ".vtp", ".vtu", ".vtk", ".3mf")},
    ".dae": "not a readable DAE file (",
}


def at(value: float) -> np.ndarray:
    W = V.copy()
    W[5, 1] = value
    return W


def binary_gltf(W: np.ndarray) -> bytes:
    tree = {"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}]}
    return with_arrays(tree, W.astype(np.float32), F.reshape(-1, 1).astype(np.uint32))


def legacy(kind: str, cells: str) -> bytes:
    """Return a file of VTK with three points, and cells that name others."""
    head = f"# vtk DataFile Version 3.0\nany\nASCII\nDATASET {kind}\nPOINTS 3 float\n"
    return f"{head}0 0 0 1 0 0 0 1 0\n{cells}\n".encode()


def cut(suffix: str) -> bytes:
    write_mesh(f"mesh{suffix}", V, F)
    content = Path(f"mesh{suffix}").read_bytes()
    return content[: 2 * len(content) // 3]


def line_cells() -> bytes:
    pyvista.UnstructuredGrid([2, 0, 1], [pyvista.CellType.LINE], V[:2]).save("mesh.vtu")
    return Path("mesh.vtu").read_bytes()


#: Suffix, content or a function that returns it, and words of the refusal.
BAD = {
    **{f"empty {end}": (end, b"", "the file is empty") for end in (".ply", ".vtp")},
    **{f"a web page as {end}": (end, b"<!DOCTYPE html>\n", words) for end, words in PAGES.items()},
    **{
        f"{end} cut": (end, partial(cut, end), f"not a readable {end[1:].upper()} file (")
        for end in (".stl", ".glb", ".vtp", ".vtu", ".vtk", ".3mf")
    },
    "compressed": (".ply", gzip.compress(mesh_ply(V, F), mtime=0), "does not begin with ply"),
    "1e999 in OBJ": (".obj", obj(V, F).replace(b"v ", b"v 1e999 ", 1), "NaN or infinite"),
    "inf in OFF": (".off", off(at(np.inf), F), "NaN or infinite"),
    "NaN in PLY": (".ply", mesh_ply(at(np.nan), F), "NaN or infinite"),
    "infinity in GLB": (".glb", partial(binary_gltf, at(np.inf)), "has a NaN or infinite coordinate"),
    "decimal commas": (".obj", obj(V, F).replace(b".", b","), "not a readable"),
    "PLY face before": (".ply", mesh_ply(V, [*F, (0, 1, -1)]), "ids go from"),
    "OBJ face beyond": (".obj", obj(V, [*F, (0, 1, 162)]), "ids go from"),
    "OBJ face of number 0": (".obj", obj(V, [*F, (0, 1, -1)]), "counted from 1"),
    "OBJ of points and lines": (".obj", lines(rows("v ", V), ["l 1 2 3"]), "triangle"),
    "OBJ of the MNI": (
        ".obj",
        b"P 0.3 0.7 0.5 100 1 3\n0 0 0\n1 0 0\n0 1 0\n\n0 0 1\n0 0 1\n0 0 1\n\n1\n0 1 1 1 1\n\n3\n\n0 1 2\n",
        "a surface object of the MNI, not of Wavefront",
    ),
    "binary OBJ of the MNI": (".obj", b"p" + np.full(5, 0.3, ">f4").tobytes() + bytes(60), "of the MNI"),
    "binary OFF": (".off", b"OFF BINARY\n\0\0\0\3\0\0\0\1\0\0\0\0" + bytes(64), "it is a binary OFF file"),
    "binary COFF": (".off", b"COFF BINARY\r\n\0\0\0\3" + bytes(90), "it is a binary OFF file"),
    "STL without facets": (".stl", bytes(84), "triangle"),
    "one face that is a point": (".obj", obj(np.zeros((3, 3)), [[0, 1, 2]]), "the only face is a point"),
    "one corner too few": (".off", off(V, [[0, 1]]), "a face needs at least three vertices"),
    "10^12 vertices": (".ply", mesh_ply(V, F, "").replace(b"x 162", b"x 1000000000000"), "not a readable"),
    "a point beyond in VTK": (
        ".vtk",
        legacy("POLYDATA", "POLYGONS 1 5\n4 0 1 2 1000000000"),
        "not a readable VTK file (a cell has a point with an id outside of 0 to 2)",
    ),
    "a point before in VTK": (
        ".vtk",
        legacy("UNSTRUCTURED_GRID", "CELLS 1 4\n3 0 1 -1\nCELL_TYPES 1\n5"),
        "a cell has a point with an id outside of 0 to 2)",
    ),
    "VTU without a surface": (".vtu", line_cells, "the file holds no triangles; give a mesh with faces"),
    "points alone": (".xyz", b"0 0 0\n1 0 0\n", "the file holds no triangles; give a mesh with faces"),
    "an unknown format": (".abc", b"a", "with the extra formats .3mf, .dae, .xyz, or with the extra figures"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_refusal_is_one_sentence_and_nothing_is_written(here, name, capfd):
    suffix, content, words = BAD[name]
    Path("pose.json").write_text('{"handles": [{"vertices": [0]}]}')
    Path(f"mesh{suffix}").write_bytes(content if isinstance(content, bytes) else content())
    capfd.readouterr()
    before = contents()
    check_refusal(run(f"sshade deform mesh{suffix} pose.json -o out.ply"), f"mesh{suffix}", words)
    assert contents() == before and capfd.readouterr() == ("", "")

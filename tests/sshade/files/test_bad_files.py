"""Files that hold no mesh, or another one than they announce, are refused in one sentence; one table."""

import gzip
import json
import struct
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import pyvista

import sshade
from sshade import InputError
from sshade.files.meshes import write_mesh
from tests.files import contents
from tests.gltf import glb, with_arrays
from tests.robustness.case import check_refusal, run
from tests.shapes import bumpy
from tests.write import lines, mesh_ply, obj, off, rows

BODY = bumpy(2)
V, F = BODY.V, BODY.F
MESH = {"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}]}
SCENE = {"scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]} | MESH


def at(value: float) -> np.ndarray:
    W = V.copy()
    W[5, 1] = value
    return W


def binary_stl(W: np.ndarray) -> bytes:
    """Return a file without normals."""
    facets = [struct.pack("<12fH", 0, 0, 0, *corners.ravel(), 0) for corners in W[F]]
    return bytes(80) + len(F).to_bytes(4, "little") + b"".join(facets)


def binary_gltf(W: np.ndarray = V, **changes) -> bytes:
    return with_arrays({**SCENE, **changes}, W.astype(np.float32), F.reshape(-1, 1).astype(np.uint32))


def gltf(**changes) -> bytes:
    """Return the JSON of a glTF file in which keys are changed; None removes a key."""
    tree = {"asset": {"version": "2.0"}, "accessors": [], **SCENE, **changes}
    return json.dumps({key: value for key, value in tree.items() if value is not None}).encode()


def linked(address: str) -> bytes:
    return gltf(accessors=[{}], buffers=[{"byteLength": 9999, "uri": address}])


def legacy(kind: str, cells: str) -> bytes:
    """Return a file of VTK with three points, and cells that name others."""
    head = f"# vtk DataFile Version 3.0\nany\nASCII\nDATASET {kind}\nPOINTS 3 float\n"
    return f"{head}0 0 0 1 0 0 0 1 0\n{cells}\n".encode()


def cut(suffix: str) -> bytes:
    write_mesh(f"whole{suffix}", V, F)
    content = Path(f"whole{suffix}").read_bytes()
    Path(f"whole{suffix}").unlink()
    return content[: 2 * len(content) // 3]


def line_cells() -> bytes:
    pyvista.UnstructuredGrid([2, 0, 1], [pyvista.CellType.LINE], V[:2]).save("whole.vtu")
    content = Path("whole.vtu").read_bytes()
    Path("whole.vtu").unlink()
    return content


OUTSIDE = "a cell has a point with an id outside of 0 to 2)"
POLYGON, STRIP = "POLYGONS 1 5\n4 0 1 2 1000000000", "TRIANGLE_STRIPS 1 4\n3 0 1 -1"
CELL = "CELLS 1 4\n3 0 1 1000000000\nCELL_TYPES 1\n5"

#: Suffix, content or a function that returns it, and words of the refusal.
BAD = {
    **{f"empty {end}": (end, b"", "the file is empty") for end in (".ply", ".obj", ".glb", ".vtp")},
    **{
        f"a web page as {end}": (end, b"<!DOCTYPE html>\n<title>404 Not Found</title>\n", words)
        for end, words in {
            ".ply": "not a readable PLY file (it does not begin with ply)",
            ".obj": "no triangles",
            ".off": "not a readable OFF file (it does not begin with OFF",
            ".stl": "not a readable STL file (it is neither a text that begins with solid",
            ".glb": "not a readable GLB file",
            ".vtp": "not a readable VTP file (",
            ".vtu": "not a readable VTU file (",
            ".vtk": "not a readable VTK file (",
            ".3mf": "not a readable 3MF file (",
            ".dae": "not a readable DAE file (",
        }.items()
    },
    **{
        f"{end} cut": (end, partial(cut, end), f"not a readable {end[1:].upper()} file (")
        for end in (".ply", ".stl", ".glb", ".vtp", ".vtu", ".vtk", ".3mf")
    },
    "compressed": (".ply", gzip.compress(mesh_ply(V, F), mtime=0), "does not begin with ply"),
    "1e999 in OBJ": (".obj", obj(V, F).replace(b"v ", b"v 1e999 ", 1), "NaN or infinite"),
    "inf in OFF": (".off", off(at(np.inf), F), "NaN or infinite"),
    "NaN in STL": (".stl", binary_stl(at(np.nan)), "NaN or infinite"),
    "infinity in GLB": (".glb", binary_gltf(at(np.inf)), "has a NaN or infinite coordinate"),
    "a word in OBJ": (".obj", obj(V, F).replace(b"v ", b"v x", 1), "not a readable"),
    "decimal commas": (".obj", obj(V, F).replace(b".", b","), "not a readable"),
    "PLY face before": (".ply", mesh_ply(V, [*F, (0, 1, -1)]), "ids go from"),
    "OBJ face beyond": (".obj", obj(V, [*F, (0, 1, 162)]), "ids go from"),
    "OBJ face of number 0": (".obj", obj(V, [*F, (0, 1, -1)]), "counted from 1"),
    "OBJ of points and lines": (".obj", lines(rows("v ", V), ["l 1 2 3"]), "triangle"),
    "STL without facets": (".stl", binary_stl(V)[:80] + bytes(4), "triangle"),
    "one face that is a point": (".obj", obj(np.zeros((3, 3)), [[0, 1, 2]]), "the only face is a point"),
    "one corner too few": (".off", off(V, [[0, 1]]), "a face needs at least three vertices"),
    "a million million vertices": (
        ".ply",
        mesh_ply(V, F, "").replace(b"vertex 162", b"vertex 1" + b"0" * 12),
        "not a readable",
    ),
    "GLB longer than it says": (".glb", binary_gltf() + bytes(4), "not a readable"),
    "GLB of version 1": (
        ".glb",
        binary_gltf().replace(b"\2", b"\1", 1),
        "a file of glTF 1, and only glTF 2.0",
    ),
    "glTF of version 1": (
        ".gltf",
        gltf(asset={"version": "1.0"}, meshes={"a": {}}),
        "a file of glTF 1.0, and",
    ),
    "glTF without its buffer": (".gltf", linked("gone.bin"), "gone.bin is missing"),
    "glTF on the web": (".gltf", linked("https://example.org/a.bin"), "not a file beside it"),
    "no mesh": (".gltf", gltf(meshes=None, nodes=[{"name": "empty"}]), "mesh.gltf: it has no mesh"),
    "a node is a text": (".gltf", gltf(nodes=["x"]), "its nodes are no list of objects"),
    "meshes are an object": (".gltf", gltf(meshes={"a": {}}), "its meshes are no list of objects"),
    "primitives are a number": (".gltf", gltf(meshes=[{"primitives": 3}]), "an entry has a wrong type"),
    "an entry that is missing": (".gltf", gltf(), "one of its entries is missing"),
    "no glTF in a GLB": (".glb", glb({"asset": 3}, b""), "it names no version of glTF"),
    "a point beyond in VTK": (".vtk", legacy("POLYDATA", POLYGON), OUTSIDE),
    "a point before in VTK": (".vtk", legacy("POLYDATA", STRIP), OUTSIDE),
    "a cell beyond in VTK": (".vtk", legacy("UNSTRUCTURED_GRID", CELL), OUTSIDE),
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


def test_python_refuses_in_the_same_words(here):
    Path("mesh.vtk").write_bytes(legacy("POLYDATA", POLYGON))
    with pytest.raises(InputError, match=r"\Amesh.vtk: not a readable VTK file \(a cell[^\n]*\Z"):
        sshade.read("mesh.vtk")

"""The command moves files of all dialects; other libraries then read only new positions and normals."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.spatial import cKDTree
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from sshade import Mesh
from tests.files import contents
from tests.gltf import with_arrays
from tests.robustness.case import run
from tests.shapes import beside, bumpy, rotation, shifted, tube
from tests.sshade.files.reading import by_trimesh
from tests.write import columns, lines, mesh_ply, obj, off, ply, rows


def single(mesh: Mesh) -> Mesh:
    """Round positions to single precision, so that all formats hold the same numbers."""
    return Mesh(mesh.V.astype(np.float32).astype(np.float64), mesh.F)


BODY = single(bumpy(2))
PAIR = single(beside(BODY, shifted(BODY, [4.0, 0, 0])))
TUBE = single(tube(12, 16))
V, F = BODY.V, BODY.F
N = V / np.linalg.norm(V, axis=1, keepdims=True)
UV = np.column_stack([np.arctan2(V[:, 1], V[:, 0]) / 7 + 0.5, V[:, 2] / 5 + 0.5])
COLOUR = (40 * (V - V.min(axis=0))).astype(int)
#: The tube in quadrilaterals; and with half of its quadrilaterals cut, and a polygon at each end.
SQUARES = TUBE.F.reshape(-1, 6)[:, :4].tolist()
CAPS = [list(range(12)), list(range(TUBE.n - 1, TUBE.n - 13, -1))]
MIXED = [*SQUARES[1::2], *(part for q in SQUARES[::2] for part in (q[:3], [q[0], *q[2:]])), *CAPS]
CAPPED = Mesh(TUBE.V, [[face[0], *face[k : k + 2]] for face in MIXED for k in range(1, len(face) - 1)])
XYZ = columns("float", "x y z", V)
NORMALS = columns("float", "nx ny nz", N)
ST = columns("float", "s t", UV)
RGBA = columns("uchar", "red green blue alpha", np.column_stack([COLOUR, COLOUR[:, 0]]))
FACES = ("vertex_indices", "uchar int", F)
CAMERA = [("view_px", "float", [1.5]), ("name", "uchar int", [[65, 66]])]
FLAGS = [("flags", "short", F[:, 0] % 9), ("weight", "double", UV[F[:, 0], 0])]
#: The content of each file.
Table = dict[str, bytes]

PLY: Table = {
    "colours, normals, coordinates": ply("<", {"vertex": [*XYZ, *NORMALS, *RGBA, *ST], "face": [FACES]}),
    "further elements": ply("<", {"camera": CAMERA, "vertex": XYZ, "face": [FACES], "tail": CAMERA}),
    "faces first": ply(">", {"face": [FACES], "vertex": XYZ}),
    "values of faces": mesh_ply(V, F, "<", face=FLAGS),
    "comments": mesh_ply(V, F, "", comments=["comment made by hand", "obj_info a scan", "comment ä"]),
    "lines of Windows": mesh_ply(V, F, "", end="\r\n"),
    "polygons": mesh_ply(TUBE.V, MIXED, "", "float"),
}


def corners(pattern: str, faces: np.ndarray = F) -> list[str]:
    """Return lines of faces, whose corners have a pattern such as {0}//{0}."""
    return ["f " + " ".join(pattern.format(i + 1) for i in face) for face in faces.tolist()]


OBJ: Table = {
    "plain": obj(V, F),
    "all attributes": lines(rows("v ", V), rows("vt ", UV), rows("vn ", N), corners("{0}/{0}/{0}")),
    "polygons": obj(TUBE.V, MIXED),
    "lines of Windows": obj(V, F, end="\r\n"),
    "colours": lines(rows("v ", np.column_stack([V, COLOUR / 255])), corners("{0}")),
    "tabs and blanks": obj(V, F).replace(b"f ", b"f\t ").replace(b"v ", b"v   "),
    "exponents": lines([f"v {x:.9e} {y:.9E} {z:+.9e}" for x, y, z in V.tolist()], corners("{0}")),
    "other scripts": lines(["# Körper 体", "o Körper"], rows("v ", V), ["usemtl кожа"], corners("{0}")),
    "unused vertices": lines(rows("v ", np.vstack([V, V[:5] + 9])), corners("{0}")),
    "coordinates behind faces": lines(rows("v ", V), corners("{0}"), rows("vt ", UV)),
}
COLOURED = [f"3 {a} {b} {c} 255 {a} 0" for a, b, c in F.tolist()]
OFF: Table = {
    "plain": off(V, F),
    "COFF": off(np.column_stack([V, COLOUR / 255, np.ones(len(V))]), F, keyword="COFF"),
    "NOFF": off(np.column_stack([V, N]), F, keyword="NOFF"),
    "colours of faces": lines(["OFF", f"{len(V)} {len(F)} 0"], rows("", V), COLOURED),
    "comments": off(V, F).replace(b"OFF\n", b"OFF # by hand\n# a body\n\n"),
}


def stl(kind: str = "stl", W: np.ndarray = V) -> bytes:
    data = trimesh.Trimesh(W, F, process=False).export(file_type=kind)
    return data.encode() if isinstance(data, str) else data


def attributed() -> bytes:
    """A binary file that begins like a text, with a number for each facet."""
    data = np.frombuffer(stl(), np.uint8).copy()
    data[:20] = np.frombuffer(b"solid made by a tool", np.uint8)
    data[84:].reshape(-1, 50)[:, 48:] = [0x1F, 0x7C]
    return data.tobytes()


SOLIDS = [stl("stl_ascii", W).replace(b"solid", b"solid part", 1) for W in (V, PAIR.V[len(V) :])]
STL: Table = {
    "binary": stl(),
    "binary that begins with solid": attributed(),
    "text": stl("stl_ascii"),
    "capitals": stl("stl_ascii").upper(),
    "several solids": b"".join(SOLIDS),
}


def exported(kind: str = "glb", *, normals: bool = False, **content: Any) -> Any:
    """Return what trimesh writes."""
    body = trimesh.Scene({"body": trimesh.Trimesh(V, F, process=False, **content)})
    return body.export(file_type=kind, include_normals=normals)


SKIN = PBRMaterial(name="skin", baseColorTexture=Image.new("RGB", (2, 2), (9, 120, 30)))
TEXTURED = {"visual": TextureVisuals(uv=UV, material=SKIN), "vertex_normals": N, "normals": True}


def scene(*nodes: dict[str, Any], parts: Any = (F,), **more: Any) -> bytes:
    """Return a .glb file of the body in one or several parts. Other arguments are keys of the JSON."""
    nodes = nodes or ({"mesh": 0},)
    attributes = {"POSITION": 0, "NORMAL": 1}
    primitives = [{"attributes": attributes, "indices": 2 + k} for k in range(len(parts))]
    tree = {"scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}], "nodes": list(nodes)}
    tree |= {"meshes": [{"primitives": primitives}], **more}
    return with_arrays(tree, V, N, *(part.reshape(-1, 1).astype(np.uint32) for part in parts))


def placed(*matrices: np.ndarray) -> Mesh:
    """Return the bodies that nodes place."""
    return beside(*(Mesh(trimesh.transform_points(V, M), F) for M in matrices))


HALF_TURN = {"mesh": 0, "rotation": [0, 0, 1, 0], "translation": [6, 0, 0], "scale": [2, 2, 2]}
TURNED = np.array([[-2, 0, 0, 6], [0, -2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1.0]])
NESTED = (
    {"mesh": 0, "name": "arm", "translation": [0, 0, 3]},
    {"children": [0], "scale": [1, 2, 1], "name": "hip"},
    {"children": [1], "rotation": [0.5, 0.5, 0.5, 0.5]},
)
#: The place of the body in these nodes.
NEST = np.array([[0, 0, 1, 3], [1, 0, 0, 0], [0, 2, 0, 0], [0, 0, 0, 1.0]])
GLTF: Table = {
    "plain": exported(),
    "texture": exported(**TEXTURED),
    "values of its own": exported(vertex_attributes={"_heat": UV[:, :1].astype(np.float32)}),
    "two primitives": scene(parts=(F[:160], F[160:])),
    "nested nodes": scene(*NESTED, scenes=[{"nodes": [2]}]),
    "instances": scene({"mesh": 0, "name": "left"}, {**HALF_TURN, "name": "right"}),
}
TABLES = {".ply": PLY, ".obj": OBJ, ".off": OFF, ".stl": STL, ".glb": GLTF}
CASES = {f"{suffix} {name}": content for suffix, table in TABLES.items() for name, content in table.items()}
#: The surfaces of files that hold another one than the body.
SURFACES = {
    **{f"{suffix} polygons": CAPPED for suffix in (".ply", ".obj")},
    ".stl several solids": PAIR,
    ".glb nested nodes": placed(NEST),
    ".glb instances": placed(np.eye(4), TURNED),
}
#: Accepted error of positions in single precision, as a fraction of the diagonal, and of normals.
NEAR, ANGLE = 1e-6, 1e-5
TURN = rotation(3)


def put_pose(mesh: Mesh) -> np.ndarray:
    """Write pose.json, in which the mesh moves as one body; return its positions then.

    Handles are positions, because vertices of the file may have other numbers.
    """
    moved = mesh.V @ TURN.T + mesh.diagonal * np.array([0.05, -0.03, 0.08])
    group = {"source": mesh.V[::4].tolist(), "target": moved[::4].tolist()}
    Path("pose.json").write_text(json.dumps({"handles": [group]}))
    return moved


@pytest.mark.parametrize("name", CASES)
def test_a_moved_file_differs_in_positions_and_normals_alone(here, name):
    mesh, path = SURFACES.get(name, BODY), Path(f"mesh{name.partition(' ')[0]}")
    posed = Path(f"posed{path.suffix}")
    path.write_bytes(CASES[name])
    expected, before = put_pose(mesh), contents()
    code, out, err = run(f"sshade deform {path} pose.json -o {posed}")
    assert code == 0 and out == "" and "warning" not in err, err
    after = contents()
    assert before.items() <= after.items() and after.keys() - before.keys() == {str(posed)}
    old, new = by_trimesh(path), by_trimesh(posed)
    assert new.V.shape == old.V.shape
    # Vertices that are not in `mesh` have no face, and stay.
    distance, vertex = cKDTree(mesh.V).query(old.V)
    near = distance < NEAR * mesh.diagonal
    assert len(np.unique(vertex[near])) == mesh.n
    target = np.where(near[:, None], expected[vertex], old.V)
    np.testing.assert_allclose(new.V, target, rtol=0, atol=NEAR * mesh.diagonal)
    np.testing.assert_allclose(new.N, old.N @ TURN.T, rtol=0, atol=ANGLE)
    np.testing.assert_equal(new.rest, old.rest)


@pytest.mark.parametrize("suffix", [".obj", ".off", ".stl", ".glb", ".gltf"])
def test_other_libraries_read_the_result_in_another_format(here, suffix):
    Path("mesh.ply").write_bytes(mesh_ply(PAIR.V, PAIR.F))
    expected = put_pose(PAIR)
    assert run(f"sshade deform mesh.ply pose.json -o posed{suffix}")[0] == 0
    found = by_trimesh(Path(f"posed{suffix}"))
    np.testing.assert_allclose(found.V[found.rest[1]], expected[PAIR.F], rtol=0, atol=NEAR * PAIR.diagonal)
    if suffix == ".stl":
        np.testing.assert_allclose(found.N, Mesh(expected, PAIR.F).face_normals, rtol=0, atol=ANGLE)

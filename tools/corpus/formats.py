"""Cases: the dialects of each format. Whatever a file holds beside positions must stay."""

from __future__ import annotations

import base64
from collections.abc import Callable
from typing import Any

import numpy as np

from tests import shapes
from tools.corpus.case import Case, one
from tools.corpus.shapes import beside, body, cubes, of
from tools.corpus.write import lines, mesh_ply, obj, off, ply, rows, solid, stl

V, F = body(2)
N = V / np.linalg.norm(V, axis=1, keepdims=True)
UV = np.column_stack([np.arctan2(V[:, 1], V[:, 0]) / 7 + 0.5, V[:, 2] / 5 + 0.5])
COLOUR = (40 * (V - V.min(axis=0))).astype(int)
#: Quads: an open tube.
TUBE = of(shapes.tube(16, 20))[0]
SQUARES = [
    (i * 16 + j, i * 16 + (j + 1) % 16, (i + 1) * 16 + (j + 1) % 16, (i + 1) * 16 + j)
    for i in range(19)
    for j in range(16)
]
#: Polygons of many sizes: the tube with caps of sixteen corners, and half of its squares cut.
MIXED: list[tuple[int, ...]] = [
    *((q[0], q[1], q[2]) for q in SQUARES[::2]),
    *((q[0], q[2], q[3]) for q in SQUARES[::2]),
    *SQUARES[1::2],
    tuple(range(15, -1, -1)),
    tuple(range(19 * 16, 20 * 16)),
]
#: The smallest possible PNG file.
PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8z8BQDwAEhQGAhKmMIQAAAABJRU5ErkJggg=="
)

XYZ = [(axis, "float", V[:, c]) for c, axis in enumerate("xyz")]
FACES = ("vertex_indices", "uchar int", F)
RGBA = [(c, "uchar", COLOUR[:, k]) for k, c in enumerate(("red", "green", "blue"))] + [
    ("alpha", "uchar", COLOUR[:, 0])
]
NORMALS = [(f"n{axis}", "float", N[:, c]) for c, axis in enumerate("xyz")]
ST = [("s", "float", UV[:, 0]), ("t", "float", UV[:, 1])]
EDGES = [
    ("vertex1", "int", F[:9, 0]),
    ("vertex2", "int", F[:9, 1]),
    ("crease", "float", np.linspace(0, 1, 9)),
]
CAMERA = [("view_px", "float", [1.5]), ("name", "uchar int", [[65, 66]])]


def _overfull() -> bytes:
    """Lines with colours that the header does not declare, as older MeshLab writes them."""
    content = mesh_ply(V, F, "", "float").decode().splitlines()
    head = content.index("end_header") + 1
    tail = [line + " 0.599829 0.2 255" if k >= head + len(V) else line for k, line in enumerate(content)]
    return lines(tail)


def _tristrips() -> bytes:
    """A tube of strips, each of which ends with -1."""
    ids: list[int] = []
    for i in range(19):
        for j in range(17):
            ids += [i * 16 + j % 16, (i + 1) * 16 + j % 16]
        ids.append(-1)
    vertex = [(axis, "float", TUBE[:, c]) for c, axis in enumerate("xyz")]
    return ply("<", {"vertex": vertex, "tristrips": [("vertex_indices", "int int", [ids])]})


PLY: dict[str, Callable[[], bytes]] = {
    **{
        f"{label} {kind}": lambda o=order, k=kind: mesh_ply(V, F, o, k)
        for label, order in (("ascii", ""), ("little endian", "<"), ("big endian", ">"))
        for kind in ("float", "double")
    },
    "colours, normals, coordinates": lambda: ply("<", {"vertex": XYZ + NORMALS + RGBA + ST, "face": [FACES]}),
    "ascii colours and normals": lambda: ply("", {"vertex": NORMALS + RGBA + XYZ, "face": [FACES]}),
    "further elements": lambda: ply(
        "<", {"camera": CAMERA, "vertex": XYZ, "edge": EDGES, "face": [FACES], "tail": CAMERA}
    ),
    "ascii further elements": lambda: ply(
        "", {"camera": CAMERA, "vertex": XYZ, "face": [FACES], "edge": EDGES}
    ),
    "faces first": lambda: ply(">", {"face": [FACES], "vertex": XYZ}),
    "face properties": lambda: mesh_ply(
        V,
        F,
        "<",
        face=[
            ("flags", "short", F[:, 0] % 9),
            ("texcoord", "uchar float", UV[F].reshape(-1, 6)),
            ("nx", "float", N[F[:, 0], 0]),
            ("ny", "float", N[F[:, 0], 1]),
            ("nz", "float", N[F[:, 0], 2]),
        ],
    ),
    "coordinates apart": lambda: ply(
        "<", {"vertex": [XYZ[2], RGBA[0], XYZ[0], ST[1], XYZ[1]], "face": [FACES]}
    ),
    "comments": lambda: mesh_ply(
        V, F, "", comments=["comment made by hand", "obj_info a scan", "comment TextureFile skin.png"]
    ),
    "vertex_index": lambda: ply("<", {"vertex": XYZ, "face": [("vertex_index", "uint uint", F)]}),
    "CRLF": lambda: mesh_ply(V, F, "", end="\r\n"),
    "squares": lambda: mesh_ply(TUBE, SQUARES, "<"),
    "polygons": lambda: mesh_ply(TUBE, MIXED, "", "float"),
    "more values than declared": _overfull,
    "tristrips": _tristrips,
}


def _seams() -> bytes:
    """Texture coordinates of each corner, several for a vertex."""
    corners = UV[F].reshape(-1, 2) + 0.01 * np.arange(3 * len(F))[:, None] % 0.5
    faces = [" ".join(f"{a + 1}/{3 * i + c + 1}" for c, a in enumerate(f)) for i, f in enumerate(F.tolist())]
    return lines(
        ["mtllib skin.mtl"], rows("v ", V), rows("vt ", corners), ["usemtl skin"], ["f " + f for f in faces]
    )


def _faces(pattern: str, faces: Any = F) -> list[str]:
    """Lines of faces, whose corners have a pattern such as {0}//{0}."""
    return ["f " + " ".join(pattern.format(i + 1) for i in face) for face in np.asarray(faces).tolist()]


def _groups() -> bytes:
    third = len(F) // 3
    parts = [
        ["o body", "g skin left", "s 1", "usemtl a"],
        _faces("{0}", F[:third]),
        ["g", "s off", "usemtl b"],
    ]
    parts += [
        _faces("{0}", F[third : 2 * third]),
        ["o rest", "l 1 2 3", "p 7"],
        _faces("{0}", F[2 * third :]),
    ]
    return lines(["# made by hand", "mtllib a.mtl", ""], rows("v ", V), *parts)


def _negative() -> bytes:
    """Two parts, each with faces that count backwards."""
    count = len(V)
    faces = ["f " + " ".join(str(i - count) for i in face) for face in F.tolist()]
    return lines(rows("v ", V), faces, rows("v ", V + [4, 0, 0]), faces)


OBJ: dict[str, Callable[[], bytes]] = {
    "plain": lambda: obj(V, F),
    "texture seams": _seams,
    "normals": lambda: lines(rows("v ", V), rows("vn ", N), _faces("{0}//{0}")),
    "all attributes": lambda: lines(rows("v ", V), rows("vt ", UV), rows("vn ", N), _faces("{0}/{0}/{0}")),
    "1--1 without normals": lambda: lines(rows("v ", V), _faces("{0}//{0}")),
    "groups and materials": _groups,
    "negative ids": _negative,
    "squares": lambda: obj(TUBE, SQUARES),
    "polygons": lambda: obj(TUBE, MIXED),
    "CRLF": lambda: obj(V, F, end="\r\n"),
    "colours": lambda: lines(rows("v ", np.column_stack([V, COLOUR / 255])), _faces("{0}")),
    "weights": lambda: lines(rows("v ", np.column_stack([V, np.ones(len(V))])), _faces("{0}")),
    "continued lines": lambda: obj(V, F).replace(b" 1\n", b" \\\n 1\n"),
    "tabs and blanks": lambda: obj(V, F).replace(b"f ", b"f\t ").replace(b"v ", b"v   "),
    "exponents": lambda: lines([f"v {x:.9e} {y:.9E} {z:+.9e}" for x, y, z in V.tolist()], _faces("{0}")),
    "other scripts": lambda: lines(
        ["# Körper 体", "o Körper"], rows("v ", V), ["usemtl кожа"], _faces("{0}")
    ),
    "unused vertices": lambda: lines(rows("v ", np.vstack([V, V[:5] + 9])), _faces("{0}")),
    "one normal for all": lambda: lines(rows("v ", TUBE[::1]), ["vn 0 0 1"], _faces("{0}//1", SQUARES)),
    "no end of line": lambda: obj(V, F).rstrip(),
    "faces between vertices": lambda: lines(rows("v ", V), _faces("{0}"), rows("vt ", UV)),
}


def _coff() -> bytes:
    return off(np.column_stack([V, COLOUR / 255, np.ones(len(V))]), F, keyword="COFF")


OFF: dict[str, Callable[[], bytes]] = {
    "plain": lambda: off(V, F),
    "COFF": _coff,
    "NOFF": lambda: off(np.column_stack([V, N]), F, keyword="NOFF"),
    "colours of faces": lambda: lines(
        ["OFF", f"{len(V)} {len(F)} 0"],
        rows("", V),
        [f"3 {a} {b} {c} 255 {k % 256} 0" for k, (a, b, c) in enumerate(F.tolist())],
    ),
    "comments": lambda: off(V, F).replace(b"OFF\n", b"OFF # by hand\n# a body\n\n"),
    "counts on the first line": lambda: off(V, F).replace(b"OFF\n", b"OFF "),
    "squares": lambda: off(TUBE, SQUARES),
    "polygons": lambda: off(TUBE, MIXED),
    "CRLF": lambda: off(V, F, end="\r\n"),
}

PARTS = [V[F], (V + [4, 0, 0])[F], (0.5 * V + [0, 6, 0])[F]]
STL: dict[str, Callable[[], bytes]] = {
    "binary": lambda: stl(V[F]),
    "binary that begins with solid": lambda: stl(V[F], head=b"solid made by a CAD program"),
    "binary with attributes": lambda: stl(V[F], attribute=0x7C1F),
    "text": lambda: lines(solid(V[F])),
    "text of few digits": lambda: lines(solid(V[F], digits="{:.6e}")),
    "text without a name": lambda: lines(solid(V[F], "")),
    "text with capitals and CRLF": lambda: lines(solid(V[F]), end="\r\n").upper(),
    "several solids": lambda: lines(*(solid(part, f"part {k}") for k, part in enumerate(PARTS))),
    "several solids of one surface": lambda: lines(solid(V[F][::2], "even"), solid(V[F][1::2], "odd")),
    "cubes": lambda: stl(cubes((0, 0, 0), (2, 0, 0))[0][cubes((0, 0, 0), (2, 0, 0))[1]]),
}


def _material() -> dict[str, bytes]:
    return {"mesh.obj": _seams(), "skin.mtl": b"newmtl skin\nmap_Kd skin.png\n", "skin.png": PIXEL}


def _several_bodies() -> bytes:
    return mesh_ply(*beside((V, F), (V + [4, 0, 0], F)))


CONVERTED = {f"ply to {s}": s for s in (".obj", ".off", ".glb", ".gltf")}
CASES = [
    *(one(f"ply/{name}", "mesh.ply", make) for name, make in PLY.items()),
    *(one(f"obj/{name}", "mesh.obj", make) for name, make in OBJ.items()),
    *(one(f"off/{name}", "mesh.off", make) for name, make in OFF.items()),
    *(one(f"stl/{name}", "mesh.stl", make) for name, make in STL.items()),
    one("stl/text without an end", "mesh.stl", lambda: lines(solid(V[F])[:-1]), says=("file is complete",)),
    Case("obj/material files", "mesh.obj", _material),
    *(
        one(f"converted/{name}", "mesh.ply", _several_bodies, output=suffix)
        for name, suffix in CONVERTED.items()
    ),
]

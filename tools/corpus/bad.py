"""Cases: files that hold no mesh, or not the mesh that they announce. Each is refused in one sentence."""

from __future__ import annotations

import gzip
from typing import Any

import numpy as np

from tools.corpus import write
from tools.corpus.case import one
from tools.corpus.plain import content
from tools.corpus.shapes import body, soup

V, F = body(2)
SUFFIXES = (".ply", ".obj", ".off", ".stl", ".glb", ".gltf")
#: Words of the refusal of a damaged file, and of a file that is no mesh file at all.
BROKEN = "not a readable"
UNREADABLE = (BROKEN, "no triangles", "is empty", "at least one triangle")
NUMBERS = ("NaN or infinite",)
NOTHING = ("no triangles", "at least one triangle")
#: Address of the buffer of a .gltf file, which holds too few bytes.
EMBEDDED = b"data:application/octet-stream;base64,AAAA"


def _sound(suffix: str, shape: Any = (V, F)) -> bytes:
    if suffix != ".gltf":
        return content(shape, suffix)
    gltf = write.Gltf()
    gltf.mesh(*shape)
    return gltf.json(EMBEDDED.decode())


def _damages(suffix: str) -> dict[str, bytes]:
    """The same damages for each format."""
    sound, other = _sound(suffix), _sound(".off" if suffix == ".ply" else ".ply")
    return {
        "empty": b"",
        "one byte": sound[:1],
        "random bytes": np.random.default_rng(1).bytes(600),
        "a web page": b"<!DOCTYPE html>\n<title>404 Not Found</title>\n",
        "only zeros": bytes(4096),
        "cut in half": sound[: len(sound) // 2 + 1],
        "cut in its last face": sound[:-5],
        "content of another format": other,
        "compressed": gzip.compress(sound, mtime=0),
    }


def _at(shape: Any, vertex: int, value: float) -> Any:
    W = shape[0].copy()
    W[vertex, 1] = value
    return W, shape[1]


def _faces(*faces: Any) -> Any:
    return V, np.array([*F.tolist(), *faces])


def _header(*lines: str, rows: str = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n") -> bytes:
    """A text PLY file of a triangle, with some other lines in its header."""
    head = [
        "format ascii 1.0",
        "element vertex 3",
        "property float x",
        "property float y",
        "property float z",
    ]
    head += ["element face 1", "property list uchar int vertex_indices"]
    for line in lines:
        key = line.split()[:2]
        head = [line if old.split()[:2] == key else old for old in head]
        head += [line] if line not in head else []
    return ("ply\n" + "\n".join(head) + "\nend_header\n" + rows).encode()


#: Suffix and contents of files by name. The words of the refusal follow, if they are not those of the table.
Table = dict[str, tuple[Any, ...]]
VALUES: Table = {
    "NaN in PLY": (".ply", lambda: _sound(".ply", _at((V, F), 5, np.nan))),
    "infinity in PLY": (".ply", lambda: _sound(".ply", _at((V, F), 5, np.inf))),
    "nan in text PLY": (".ply", lambda: write.mesh_ply(*_at((V, F), 5, np.nan), "")),
    "nan in OBJ": (".obj", lambda: _sound(".obj", _at((V, F), 5, np.nan)), *NUMBERS, BROKEN),
    "1e999 in OBJ": (".obj", lambda: _sound(".obj").replace(b"v ", b"v 1e999 ", 1), *NUMBERS, BROKEN),
    "inf in OFF": (".off", lambda: _sound(".off", _at((V, F), 5, np.inf)), *NUMBERS, BROKEN),
    "NaN in STL": (".stl", lambda: _sound(".stl", _at((V, F), 5, np.nan))),
    "NaN in GLB": (".glb", lambda: _sound(".glb", _at((V, F), 5, np.nan)), *NUMBERS, BROKEN),
    "a word in OBJ": (".obj", lambda: _sound(".obj").replace(b"v ", b"v x", 1), BROKEN),
    "a comma in OBJ": (".obj", lambda: _sound(".obj").replace(b".", b","), BROKEN),
}
RANGES: Table = {
    "PLY face beyond the vertices": (".ply", lambda: _sound(".ply", _faces([0, 1, 999]))),
    "PLY face before the vertices": (".ply", lambda: _sound(".ply", _faces([0, 1, -1]))),
    "OFF face beyond the vertices": (".off", lambda: _sound(".off", _faces([0, 1, 162]))),
    "OBJ face beyond the vertices": (".obj", lambda: _sound(".obj", _faces([0, 1, 162]))),
    "OBJ face of number 0": (".obj", lambda: _sound(".obj", _faces([0, 1, -1])), "counted from 1"),
    "OBJ face far back": (
        ".obj",
        lambda: _sound(".obj", _faces([0, 1, -999])),
        "ids go from",
        "more vertices than",
    ),
    "GLB triangle beyond the vertices": (
        ".glb",
        lambda: _sound(".glb", _faces([0, 1, 999])),
        "refers to vertex 999",
    ),
    "PLY face of two corners": (".ply", lambda: write.mesh_ply(V, [*F.tolist(), [1, 2]]), "2 corners"),
    "OBJ face of two corners": (".obj", lambda: write.obj(V, [*F.tolist(), [1, 2]]), "three vertices"),
    "PLY corner 1.5": (".ply", lambda: _header(rows="0 0 0\n1 0 0\n0 1 0\n3 0 1 1.5\n"), "whole number"),
}
NONE: Table = {
    "PLY of points": (".ply", lambda: write.mesh_ply(V, [])),
    "OBJ of points": (".obj", lambda: write.lines(write.rows("v ", V))),
    "OBJ of lines": (".obj", lambda: write.lines(write.rows("v ", V), ["l 1 2 3"])),
    "OBJ of comments": (".obj", lambda: b"# an empty scene\n"),
    "OFF of points": (".off", lambda: write.off(V, [])),
    "STL without facets": (".stl", lambda: write.stl(np.zeros((0, 3, 3)))),
    "text STL without facets": (".stl", lambda: b"solid a\nendsolid a\n", *NOTHING, BROKEN),
    "GLB without meshes": (".glb", lambda: write.Gltf().glb()),
    "PLY of no vertices": (".ply", lambda: write.mesh_ply(np.zeros((0, 3)), [])),
}
REPEATED: Table = {
    "all faces repeat a vertex": (".ply", lambda: write.mesh_ply(V, F[:, [0, 1, 0]])),
    "all corners equal in OBJ": (".obj", lambda: write.obj(V, F[:, [1, 1, 1]])),
    "two vertices": (".ply", lambda: write.mesh_ply(V[:2], [[0, 1, 0]])),
}
POINTS: Table = {
    "all vertices in one place": (".ply", lambda: write.mesh_ply(np.ones_like(V), F)),
    "all facets are points": (".stl", lambda: write.stl(V[F][:, [0, 0, 0]])),
    "all zeros in STL": (".stl", lambda: write.stl(np.zeros((40, 3, 3)))),
}
HEADERS: Table = {
    "PLY without an end of its header": (".ply", lambda: _header().replace(b"end_header\n", b"")),
    "PLY of an unknown encoding": (
        ".ply",
        lambda: _header("format binary 1.0").replace(b"format ascii 1.0\n", b""),
    ),
    "PLY of an unknown type": (
        ".ply",
        lambda: _header("property float y").replace(b"float y", b"half y"),
    ),
    "PLY without z": (".ply", lambda: _header().replace(b"property float z\n", b"")),
    "PLY that announces more vertices": (".ply", lambda: _header("element vertex 4")),
    "PLY that announces 10^12 vertices": (".ply", lambda: _header("element vertex 1000000000000")),
    "PLY that announces 10^12 faces": (".ply", lambda: _header("element face 1000000000000")),
    "PLY that announces -1 faces": (".ply", lambda: _header("element face -1")),
    "OFF that announces more faces": (".off", lambda: write.off(V, F).replace(b" 320 0", b" 321 0")),
    "OFF without counts": (".off", lambda: b"OFF\n"),
    "4OFF": (".off", lambda: write.off(V, F, keyword="4OFF")),
    "STL with bytes behind its end": (".stl", lambda: _sound(".stl") + b"abc"),
    "text STL of squares": (
        ".stl",
        lambda: write.lines(write.solid(V[F])).replace(b" endloop", b" vertex 0 0 0\n endloop", 1),
    ),
    "GLB longer than it says": (".glb", lambda: _sound(".glb") + bytes(4)),
    "GLB of version 1": (".glb", lambda: _sound(".glb").replace(b"glTF\2", b"glTF\1", 1)),
    "glTF without its buffer": (
        ".gltf",
        lambda: _sound(".gltf").replace(EMBEDDED, b"gone.bin"),
        "gone.bin is missing",
    ),
    "glTF on the web": (
        ".gltf",
        lambda: _sound(".gltf").replace(EMBEDDED, b"https://example.org/a.bin"),
        "not a file beside it",
    ),
    "glTF of a short buffer": (".gltf", lambda: _sound(".gltf")),
    "OBJ in UTF-16": (".obj", lambda: write.obj(V, F).decode().encode("utf-16"), *UNREADABLE),
}
#: Each table, and the words of its refusals.
TABLES = (
    (VALUES, NUMBERS),
    (RANGES, ("ids go from",)),
    (NONE, NOTHING),
    (REPEATED, ("repeat a vertex",)),
    (POINTS, ("faces are points",)),
    (HEADERS, (BROKEN,)),
)
SUFFIX = {"mesh.fbx": ".fbx", "mesh": "unknown format", "mesh.ply.zip": ".zip", "mesh.vtk": ".vtk"}


def _far_soup() -> bytes:
    """Triangles far apart: most have no handle, and no repair can change that."""
    W, G = soup((V, F))
    return write.mesh_ply(W + 0.5 * W[G].mean(axis=1).repeat(3, axis=0), G)


CASES = [
    *(
        one(
            f"bad/{suffix[1:]} {name}",
            f"mesh{suffix}",
            lambda s=suffix, n=name: _damages(s)[n],
            refused=UNREADABLE,
        )
        for suffix in SUFFIXES
        for name in _damages(suffix)
    ),
    *(
        one(f"bad/{name}", f"mesh{suffix}", make, refused=tuple(words) or usual)
        for table, usual in TABLES
        for name, (suffix, make, *words) in table.items()
    ),
    *(
        one(f"bad/suffix of {name}", name, lambda: _sound(".ply"), refused=(word,))
        for name, word in SUFFIX.items()
    ),
    one(
        "bad/triangles without handles",
        "mesh.ply",
        _far_soup,
        handles=b'{"handles": [{"vertices": [0]}]}',
        refused=("components",),
    ),
]

"""Files that hold no mesh, or another one than they announce, are refused in one sentence."""

import gzip
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.files import contents
from tests.gltf import glb, taken_apart, with_arrays
from tests.robustness.case import check_refusal, run
from tests.shapes import bumpy, unjoined
from tests.write import lines, mesh_ply, obj, off, rows

BODY = bumpy(2)
V, F = BODY.V, BODY.F
SUFFIXES = (".ply", ".obj", ".off", ".stl", ".glb", ".gltf")
#: A text PLY file of a triangle.
TRIANGLE = b"""ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""
SCENE = {"scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]}
SCENE |= {"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}]}


def sound(suffix: str, W: np.ndarray = V, G: np.ndarray = F) -> bytes:
    """Return a file of the body, or of other positions and triangles."""
    writers = {".ply": mesh_ply, ".obj": obj, ".off": off}
    if suffix in writers:
        return writers[suffix](W, G)
    if suffix == ".stl":
        return trimesh.Trimesh(W, G, process=False).export(file_type="stl")
    data = with_arrays(SCENE, W, G.reshape(-1, 1).astype(np.uint32))
    return data if suffix == ".glb" else linked("data:application/octet-stream;base64,AAAA")


def linked(address: str) -> bytes:
    """Return a .gltf file whose buffer has an address."""
    text = sound(".glb")[20:]
    text = (
        text[: text.index(b'"buffers"')] + b'"buffers":[{"byteLength":9999,"uri":"%s"}]}' % address.encode()
    )
    return text


def at(value: float) -> np.ndarray:
    W = V.copy()
    W[5, 1] = value
    return W


def beyond(*ids: int) -> np.ndarray:
    return np.concatenate([F, [ids]])


def changed(old: bytes, new: bytes, data: bytes = TRIANGLE) -> bytes:
    assert old in data
    return data.replace(old, new, 1)


DAMAGES: dict[str, Callable[[str], bytes]] = {
    "empty": lambda suffix: b"",
    "one byte": lambda suffix: sound(suffix)[:1],
    "random bytes": lambda suffix: np.random.default_rng(1).bytes(600),
    "a web page": lambda suffix: b"<!DOCTYPE html>\n<title>404 Not Found</title>\n",
    "only zeros": lambda suffix: bytes(4096),
    "cut in half": lambda suffix: sound(suffix)[: len(sound(suffix)) // 2 + 1],
    "cut in its last face": lambda suffix: sound(suffix)[:-5],
    "content of another format": lambda suffix: sound(".off" if suffix == ".ply" else ".ply"),
    "compressed": lambda suffix: gzip.compress(sound(suffix), mtime=0),
}
UNREADABLE = ("not a readable", "no triangles", "is empty", "at least one triangle")


def scene(**more: object) -> bytes:
    tree, buffer = taken_apart(sound(".glb"))
    return glb(tree | more, buffer)


def apart() -> tuple[np.ndarray, np.ndarray]:
    """Triangles far from each other, of which one has a handle."""
    soup = unjoined(BODY)
    return soup.V + 0.5 * soup.V[soup.F].mean(axis=1).repeat(3, axis=0), soup.F


#: Suffix, content, and words of the refusal.
BAD: dict[str, tuple[str, bytes, str]] = {
    "NaN in PLY": (".ply", sound(".ply", at(np.nan)), "NaN or infinite"),
    "infinity in PLY": (".ply", sound(".ply", at(np.inf)), "NaN or infinite"),
    "1e999 in OBJ": (".obj", changed(b"v ", b"v 1e999 ", sound(".obj")), "NaN or infinite"),
    "inf in OFF": (".off", sound(".off", at(np.inf)), "NaN or infinite"),
    "NaN in STL": (".stl", sound(".stl", at(np.nan)), "NaN or infinite"),
    "a word in OBJ": (".obj", changed(b"v ", b"v x", sound(".obj")), "not a readable"),
    "decimal commas": (".obj", sound(".obj").replace(b".", b","), "not a readable"),
    "PLY face beyond": (".ply", sound(".ply", V, beyond(0, 1, 999)), "ids go from"),
    "PLY face before": (".ply", sound(".ply", V, beyond(0, 1, -1)), "ids go from"),
    "OFF face beyond": (".off", sound(".off", V, beyond(0, 1, 162)), "ids go from"),
    "OBJ face beyond": (".obj", sound(".obj", V, beyond(0, 1, 162)), "ids go from"),
    "OBJ face of number 0": (".obj", sound(".obj", V, beyond(0, 1, -1)), "counted from 1"),
    "GLB triangle beyond": (".glb", sound(".glb", V, beyond(0, 1, 999)), "refers to vertex 999"),
    "PLY face of two corners": (".ply", mesh_ply(V, [*F.tolist(), [1, 2]]), "2 corners"),
    "PLY corner of 1.5": (".ply", changed(b"3 0 1 2", b"3 0 1 1.5"), "whole number"),
    "PLY of points": (".ply", mesh_ply(V, []), "triangle"),
    "OBJ of points and lines": (".obj", lines(rows("v ", V), ["l 1 2 3"]), "triangle"),
    "STL without facets": (".stl", sound(".stl")[:80] + bytes(4), "triangle"),
    "all faces repeat a vertex": (".ply", mesh_ply(V, F[:, [0, 1, 0]]), "repeat a vertex"),
    "all vertices in one place": (".ply", mesh_ply(np.ones_like(V), F), "faces are points"),
    "no end of the header": (".ply", changed(b"end_header\n", b""), "not a readable"),
    "PLY of an unknown type": (".ply", changed(b"float y", b"half y"), "not a readable"),
    "PLY without z": (".ply", changed(b"property float z\n", b""), "not a readable"),
    "a million million vertices": (".ply", changed(b"vertex 3", b"vertex 1" + b"0" * 12), "not a readable"),
    "-1 faces": (".ply", changed(b"face 1", b"face -1"), "not a readable"),
    "OFF of four coordinates": (".off", off(V, F, keyword="4OFF"), "not a readable"),
    "OFF that announces more faces": (".off", changed(b" 320 0", b" 321 0", off(V, F)), "not a readable"),
    "STL with bytes behind its end": (".stl", sound(".stl") + b"abc", "not a readable"),
    "GLB longer than it says": (".glb", sound(".glb") + bytes(4), "not a readable"),
    "glTF without its buffer": (".gltf", linked("gone.bin"), "gone.bin is missing"),
    "glTF on the web": (".gltf", linked("https://example.org/a.bin"), "not a file beside it"),
    "a skin": (".glb", scene(skins=[{"joints": [0]}]), "a skin"),
    "compressed buffers": (".glb", scene(extensionsUsed=["KHR_draco_mesh_compression"]), "compressed"),
    "an unknown format": (".fbx", sound(".ply"), ".fbx"),
    "triangles without handles": (".ply", mesh_ply(*apart()), "components"),
}

P = V.tolist()
MOVED = {"vertices": [7, 8, 9], "target": P[17:20]}
SHEAR, SHIFT = [[1, 1, 0], [0, 1, 0], [0, 0, 1]], [0.1, 0.2, 0.3]
FIXED = {"vertices": [0]}
#: An entry of a handle file, and words of the refusal.
HANDLES: dict[str, tuple[object, str]] = {
    "a number for an entry": (1, "entry 0"),
    "an unknown kind": ({"kind": "moving", "vertices": [1]}, "unknown kind"),
    "neither ids nor positions": ({"kind": "static"}, '"vertices"'),
    "dynamic without a motion": ({"kind": "dynamic", "vertices": [1]}, "it is dynamic and has no"),
    "fewer targets than ids": ({"vertices": [1, 2], "target": [P[1]]}, "2 handles have 1 targets"),
    "an id beyond the mesh": ({"vertices": [162]}, "0..161, not 162"),
    "ids that are text": ({"vertices": ["1"]}, "a text in place of a number"),
    "a run that is no pair": ({"vertices": {"runs": [[1, 2, 3]]}}, "list of pairs [first id, count]"),
    "half of an array": (
        {"vertices": {"base64": "AAAA", "dtype": "<i4", "shape": [1]}},
        'do not fit its "shape"',
    ),
    "a number of 400 digits": ({"source": [[0, 1, 10**400]]}, "too large"),
    "a key of another program": ({**MOVED, "comment": "left foot"}, "begin with _"),
    "a target of NaN": ({"vertices": [1], "target": [[0, np.nan, 0]]}, "NaN"),
    "a weight of 0": ({"vertices": [1], "weight": 0}, '"weight"'),
    "a rotation that shears": ({"vertices": [1], "rotation": SHEAR, "translation": SHIFT}, "is no rotation"),
    "a long quaternion": ({"vertices": [1], "rotation": [1, 1, 0, 0], "translation": SHIFT}, "quaternion"),
    "a misspelt key": ({"vertices": [1], "trnslation": SHIFT}, '"translation"'),
    "swapped corners of a box": ({"boxes": [[[9, 9, 9], [-9, -9, -9]]], "translation": SHIFT}, "corners"),
    "an empty box": ({"boxes": [[[90, 90, 90], [91, 91, 91]]]}, "entry 0"),
    "a position far away": ({"source": [[50, 0, 0]]}, "diagonal"),
    "contradictory targets": ({"vertices": [50, 50], "target": [P[50], P[51]]}, "contradictory"),
    "a target and a translation": ({**MOVED, "translation": SHIFT}, '"translation"'),
}


def refuse(suffix: str, data: bytes, *words: str, entry: object = FIXED) -> str:
    Path(f"mesh{suffix}").write_bytes(data)
    Path("pose.json").write_text(json.dumps({"handles": [entry]}))
    before = contents()
    ended = run(f"sshade deform mesh{suffix} pose.json -o out.ply --method fast")
    check_refusal(ended, *words)
    assert contents() == before
    return ended[2]


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("name", DAMAGES)
def test_damaged_files_are_refused(here, name, suffix):
    message = refuse(suffix, DAMAGES[name](suffix), f"mesh{suffix}")
    assert any(words in message for words in UNREADABLE), message


@pytest.mark.parametrize("name", BAD)
def test_the_reason_is_told(here, name):
    suffix, data, words = BAD[name]
    refuse(suffix, data, words)


@pytest.mark.parametrize("name", HANDLES)
def test_wrong_handles_are_refused(here, name):
    entry, words = HANDLES[name]
    refuse(".ply", sound(".ply"), words, entry=entry)

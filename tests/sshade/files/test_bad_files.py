"""Files that hold no mesh, or another one than they announce, are refused in one sentence."""

import gzip
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.files import contents
from tests.gltf import with_arrays
from tests.robustness.case import check_refusal, run
from tests.shapes import bumpy
from tests.write import lines, mesh_ply, obj, off, rows

BODY = bumpy(2)
V, F = BODY.V, BODY.F
SUFFIXES = (".ply", ".obj", ".off", ".stl", ".glb", ".gltf")
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


def changed(old: bytes, new: bytes, data: bytes) -> bytes:
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


#: Suffix, content, and words of the refusal.
BAD: dict[str, tuple[str, bytes, str]] = {
    "1e999 in OBJ": (".obj", changed(b"v ", b"v 1e999 ", sound(".obj")), "NaN or infinite"),
    "inf in OFF": (".off", sound(".off", at(np.inf)), "NaN or infinite"),
    "NaN in STL": (".stl", sound(".stl", at(np.nan)), "NaN or infinite"),
    "a word in OBJ": (".obj", changed(b"v ", b"v x", sound(".obj")), "not a readable"),
    "decimal commas": (".obj", sound(".obj").replace(b".", b","), "not a readable"),
    "PLY face before": (".ply", sound(".ply", V, beyond(0, 1, -1)), "ids go from"),
    "OBJ face beyond": (".obj", sound(".obj", V, beyond(0, 1, 162)), "ids go from"),
    "OBJ face of number 0": (".obj", sound(".obj", V, beyond(0, 1, -1)), "counted from 1"),
    "OBJ of points and lines": (".obj", lines(rows("v ", V), ["l 1 2 3"]), "triangle"),
    "STL without facets": (".stl", sound(".stl")[:80] + bytes(4), "triangle"),
    "a million million vertices": (
        ".ply",
        changed(b"vertex 162", b"vertex 1" + b"0" * 12, mesh_ply(V, F, "")),
        "not a readable",
    ),
    "GLB longer than it says": (".glb", sound(".glb") + bytes(4), "not a readable"),
    "glTF without its buffer": (".gltf", linked("gone.bin"), "gone.bin is missing"),
    "glTF on the web": (".gltf", linked("https://example.org/a.bin"), "not a file beside it"),
    "an unknown format": (".fbx", sound(".ply"), ".fbx"),
}


def refuse(suffix: str, data: bytes, *words: str) -> str:
    Path(f"mesh{suffix}").write_bytes(data)
    Path("pose.json").write_text(json.dumps({"handles": [{"vertices": [0]}]}))
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

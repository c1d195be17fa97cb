"""Cases: glTF files, with scenes, seams, textures and external files."""

from __future__ import annotations

import base64
from collections.abc import Callable
from typing import Any

import numpy as np

from tools.corpus.case import Case, one
from tools.corpus.formats import COLOUR, PIXEL, UV, F, N, V
from tools.corpus.shapes import cubes
from tools.corpus.write import Gltf


def _scene(make: Callable[[Gltf], Any]) -> Callable[[], bytes]:
    def content() -> bytes:
        gltf = Gltf()
        make(gltf)
        return gltf.glb()

    return content


HALF_TURN = {"rotation": [0, 0, 1, 0], "translation": [5, 0, 0], "scale": [2, 2, 2]}
SKEW = [1, 0, 0, 0, 0.3, 1, 0, 0, 0, 0, 2, 0, 3, -1, 2, 1]


def _nested(gltf: Gltf) -> None:
    gltf.mesh(V, F, node={"name": "arm", "translation": [0, 0, 3]})
    gltf.tree["nodes"].append({"children": [0], "scale": [1, 2, 1], "name": "hip"})
    gltf.tree["nodes"].append({"children": [1], "rotation": [0.5, 0.5, 0.5, 0.5]})
    gltf.tree["scenes"][0]["nodes"] = [2]


def _several(gltf: Gltf) -> None:
    for k in range(3):
        gltf.mesh(V, F, node={"translation": [4.0 * k, 0, 0], "name": f"part {k}"})


def _seam_glb(gltf: Gltf) -> None:
    """Vertices along a meridian are there twice, with other texture coordinates."""
    behind = V[F].mean(axis=1)[:, 0] > 0
    copy = np.where(np.isin(np.arange(len(V)), F[~behind]), len(V) + np.arange(len(V)), -1)
    G = F.copy()
    G[~behind] = copy[F[~behind]]
    used = np.unique(G)
    W = np.vstack([V, V])[used]
    gltf.mesh(
        W,
        np.searchsorted(used, G),
        TEXCOORD_0=np.vstack([UV, UV + 0.5])[used],
        NORMAL=np.vstack([N, N])[used],
    )


def _textured(gltf: Gltf) -> None:
    tangents = np.column_stack([np.cross(N, [0, 0, 1.0]), np.ones(len(N))])
    tangents[:, :3] /= np.linalg.norm(tangents[:, :3], axis=1, keepdims=True) + 1e-12
    gltf.mesh(V, F, NORMAL=N, TANGENT=tangents, TEXCOORD_0=UV, COLOR_0=COLOUR / 255, _TEMPERATURE=UV[:, 0])
    gltf.tree["meshes"][0]["primitives"][0]["material"] = 0
    image = {"bufferView": gltf.view(PIXEL), "mimeType": "image/png"}
    gltf.tree |= {"images": [image], "textures": [{"source": 0}], "extras": {"author": "nobody"}}
    gltf.tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "name": "skin"}]


def _primitives(gltf: Gltf) -> None:
    """Two primitives of one mesh share their positions."""
    half = len(F) // 2
    gltf.mesh(V, F[:half], NORMAL=N)
    first = gltf.tree["meshes"][0]["primitives"][0]
    gltf.tree["meshes"][0]["primitives"].append({**first, "indices": gltf.array(F[half:].ravel(), "<u4")})


def _plain(W: np.ndarray, **changes: Any) -> Callable[[Gltf], None]:
    """A mesh without indices, or with indices of another kind."""

    def make(gltf: Gltf) -> None:
        gltf.mesh(W, changes.get("ids", [0]), ids=changes.get("kind", "<u4"))
        primitive = gltf.tree["meshes"][0]["primitives"][0]
        primitive |= {"mode": changes["mode"]} if "mode" in changes else {}
        if "ids" not in changes:
            del primitive["indices"]

    return make


def _instances(gltf: Gltf) -> None:
    gltf.mesh(V, F, NORMAL=N, node={"name": "left"})
    gltf.show(0, name="right", **HALF_TURN)
    gltf.show(0, name="top", translation=[0, 6, 0])


def _interleaved(gltf: Gltf) -> None:
    data = np.column_stack([V, N, UV]).astype("<f4")
    view = gltf.view(data.tobytes())
    gltf.tree["bufferViews"][view]["byteStride"] = 32
    gltf.mesh(V, F)
    attributes = gltf.tree["meshes"][0]["primitives"][0]["attributes"]
    for name, offset, kind in (("POSITION", 0, "VEC3"), ("NORMAL", 12, "VEC3"), ("TEXCOORD_0", 24, "VEC2")):
        attributes[name] = len(gltf.tree["accessors"])
        gltf.tree["accessors"].append(
            {"bufferView": view, "byteOffset": offset, "componentType": 5126, "count": len(V), "type": kind}
        )


def _sparse(gltf: Gltf) -> None:
    """A quarter of the positions replaces others."""
    rows = np.arange(0, len(V), 4)
    flattened = np.where(np.arange(len(V))[:, None] % 4, V, 0.5 * V)
    gltf.mesh(flattened, F)
    ids, values = gltf.view(rows.astype("<u2").tobytes()), gltf.view(V[rows].astype("<f4").tobytes())
    gltf.tree["accessors"][0]["sparse"] = {
        "count": len(rows),
        "indices": {"bufferView": ids, "componentType": 5123},
        "values": {"bufferView": values},
    }


def _quantised(gltf: Gltf) -> None:
    """Positions are whole numbers of two bytes, which the node scales."""
    gltf.mesh(V, F, node={"scale": [3, 3, 3], "name": "body"})
    values = np.pad(np.round(V / 3 * 32767), ((0, 0), (0, 1))).astype("<i2")
    view = gltf.view(values.tobytes())
    gltf.tree["bufferViews"][view]["byteStride"] = 8
    gltf.tree["accessors"][0] = {
        "bufferView": view,
        "componentType": 5122,
        "normalized": True,
        "count": len(V),
        "type": "VEC3",
        "min": values[:, :3].min(0).tolist(),
        "max": values[:, :3].max(0).tolist(),
    }
    gltf.tree |= {name: ["KHR_mesh_quantization"] for name in ("extensionsUsed", "extensionsRequired")}


def _with_points(gltf: Gltf) -> None:
    gltf.mesh(V, F)
    gltf.mesh(V + 4, np.arange(9))
    gltf.tree["meshes"][1]["primitives"][0]["mode"] = 0


STRIP = [i * 2 + j for i in range(20) for j in (0, 1)]
RIBBON = np.array([[0.3 * (k // 2), k % 2, 0.2 * np.sin(k)] for k in range(40)])
CUBE = cubes((0, 0, 0), cells=2)
GLB: dict[str, Callable[[Gltf], Any]] = {
    "plain": lambda g: g.mesh(V, F),
    "indices of two bytes": lambda g: g.mesh(V, F, ids="<u2"),
    "indices of one byte": lambda g: g.mesh(*CUBE, ids="|u1"),
    "without indices": _plain(V[F].reshape(-1, 3)),
    "strip": _plain(RIBBON, ids=STRIP, mode=5),
    "fan": _plain(
        np.vstack([[[0, 0, 1]], np.c_[np.cos(np.arange(20) / 3), np.sin(np.arange(20) / 3), np.zeros(20)]]),
        ids=list(range(19)),
        mode=6,
    ),
    "seams": _seam_glb,
    "texture and tangents": _textured,
    "placed by a node": lambda g: g.mesh(V, F, NORMAL=N, node=HALF_TURN),
    "placed by a matrix": lambda g: g.mesh(V, F, NORMAL=N, node={"matrix": SKEW}),
    "mirrored": lambda g: g.mesh(V, F, NORMAL=N, node={"scale": [-1, 1, 1]}),
    "nested nodes": _nested,
    "several meshes": _several,
    "two primitives": _primitives,
    "instances": _instances,
    "interleaved": _interleaved,
    "sparse positions": _sparse,
    "quantised positions": _quantised,
    "points beside triangles": _with_points,
}


def _with(gltf: Gltf, change: Callable[[dict[str, Any]], Any]) -> None:
    gltf.mesh(V, F)
    change(gltf.tree)


#: Contents of glTF that a person accepts not to be deformed, and words of the refusal.
REFUSED_GLB: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "skin": (lambda t: t.update(skins=[{"joints": [0]}]), "a skin"),
    "morph targets": (
        lambda t: t["meshes"][0]["primitives"][0].update(targets=[{"POSITION": 0}]),
        "morph targets",
    ),
    "compressed": (lambda t: t.update(extensionsUsed=["KHR_draco_mesh_compression"]), "compressed buffers"),
    "points alone": (lambda t: t["meshes"][0]["primitives"][0].update(mode=0), "no triangles"),
}


def _external() -> dict[str, bytes]:
    gltf = Gltf()
    _textured(gltf)
    gltf.tree["images"][0] = {"uri": "skin%20a.png"}
    return {"mesh.gltf": gltf.json("mesh%20data.bin"), "mesh data.bin": gltf.binary, "skin a.png": PIXEL}


def _embedded() -> bytes:
    gltf = Gltf()
    _seam_glb(gltf)
    return gltf.json("data:application/octet-stream;base64," + base64.b64encode(gltf.binary).decode())


CASES = [
    *(one(f"gltf/{name}", "mesh.glb", _scene(make)) for name, make in GLB.items()),
    *(
        one(f"gltf/{name}", "mesh.glb", _scene(lambda g, c=change: _with(g, c)), refused=(words,))
        for name, (change, words) in REFUSED_GLB.items()
    ),
    Case("gltf/external files", "mesh.gltf", _external),
    one("gltf/embedded", "mesh.gltf", _embedded),
]

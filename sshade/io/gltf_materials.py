"""Colours of vertices, materials and textures of glTF files."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np

from sshade.io.gltf_scene import dense
from sshade.io.skins import Material, Skin, require_image, srgb


def gltf_colours(
    tree: dict[str, Any], buffers: list[bytes], parts: Iterable[tuple[int, int | None]]
) -> np.ndarray:
    """Return the colours (n, 3) of vertices in sRGB; white where a part has none.

    Parameters
    ----------
    tree, buffers
        The file.
    parts : iterable of (int, int or None)
        Number of vertices of each part, and the accessor of its colours.
    """
    rows = [np.ones((n, 3)) if one is None else _values(tree, buffers, one)[:, :3] for n, one in parts]
    return srgb(np.concatenate(rows))


def gltf_skin(
    tree: dict[str, Any],
    buffers: list[bytes],
    source: Path,
    primitives: list[tuple[dict[str, Any], np.ndarray]],
) -> Skin:
    """Return the materials of the primitives of a file.

    Parameters
    ----------
    tree, buffers, source
        The file.
    primitives : list of (dict, (k, 3) int64)
        Each primitive, and the corners of its triangles as numbers of its vertices.

    Raises
    ------
    ValueError
        When the file refers to missing entries.
    """
    materials = [_material(tree, buffers, source, one) for one in [{}, *tree.get("materials", [])]]
    uv, corners, material, count = [np.zeros((1, 2))], [], [], 1
    for primitive, F in primitives:
        number = primitive.get("material", -1)
        info = {} if number < 0 else tree["materials"][number].get("pbrMetallicRoughness", {})
        texture = info.get("baseColorTexture", {})
        moved = texture.get("extensions", {}).get("KHR_texture_transform", {})
        set_ = moved.get("texCoord", texture.get("texCoord", 0))
        accessor = primitive["attributes"].get(f"TEXCOORD_{set_}")
        material.append(np.full(len(F), number + 1))
        if accessor is None:
            corners.append(np.zeros_like(F))
            continue
        own = _values(tree, buffers, accessor)[:, :2]
        uv.append(own * moved.get("scale", [1, 1]) + moved.get("offset", [0, 0]))
        corners.append(count + F)
        count += len(own)
    return Skin(np.concatenate(uv), np.concatenate(corners), np.concatenate(material), materials)


def _values(tree: dict[str, Any], buffers: list[bytes], accessor: int) -> np.ndarray:
    """Return the numbers (k, width) of an accessor; whole numbers are parts of the largest of their type."""
    values = dense(tree, buffers, accessor)
    kind = values.dtype
    return values.astype(np.float64) / (np.iinfo(kind).max if kind.kind in "iu" else 1.0)


def _material(tree: dict[str, Any], buffers: list[bytes], source: Path, one: dict[str, Any]) -> Material:
    info = one.get("pbrMetallicRoughness", {})
    colour = srgb(np.array(info.get("baseColorFactor", [1.0, 1.0, 1.0, 1.0])[:3], dtype=np.float64))
    if "baseColorTexture" not in info:
        return Material(colour)
    texture = tree["textures"][info["baseColorTexture"]["index"]]
    webp = texture.get("extensions", {}).get("EXT_texture_webp", {})
    number = webp.get("source", texture.get("source"))
    if number is None:  # of a format that only an extension knows
        return Material(colour)
    return Material(colour, partial(_image, tree, buffers, source, tree["images"][number]))


def _image(tree: dict[str, Any], buffers: list[bytes], source: Path, image: dict[str, Any]) -> bytes:
    if "bufferView" in image:
        view = tree["bufferViews"][image["bufferView"]]
        begin = view.get("byteOffset", 0)
        return require_image(bytes(buffers[view["buffer"]][begin : begin + view["byteLength"]]))
    uri = image["uri"]
    if uri.startswith("data:"):
        head, _, body = uri.partition(",")
        return require_image(base64.b64decode(body) if head.endswith(";base64") else unquote_to_bytes(body))
    return require_image((source.parent / unquote(uri)).read_bytes())

"""Materials and textures of glTF files."""

from __future__ import annotations

import base64
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np

from sshade.files.gltf import shown_primitives
from sshade.files.gltf_scene import Gltf, is_embedded
from sshade.files.materials import Material, Skin, srgb
from sshade.files.mesh_file import beside


def gltf_skin(path: Path) -> Skin:
    """Return the materials of a .glb or a .gltf.

    Raises
    ------
    ValueError
        When the file refers to missing entries.
    """
    gltf, _, shown = shown_primitives(path)
    materials = [_material(gltf, one) for one in [{}, *gltf.tree.get("materials", [])]]
    uv, corners, material, count = [np.zeros((1, 2))], [], [], 1
    for primitive, _, F in shown:
        number = primitive.get("material", -1)
        info = {} if number < 0 else gltf.tree["materials"][number].get("pbrMetallicRoughness", {})
        texture = info.get("baseColorTexture", {})
        moved = texture.get("extensions", {}).get("KHR_texture_transform", {})
        set_ = moved.get("texCoord", texture.get("texCoord", 0))
        accessor = primitive["attributes"].get(f"TEXCOORD_{set_}")
        material.append(np.full(len(F), number + 1))
        if accessor is None:
            corners.append(np.zeros_like(F))
            continue
        own = gltf.fractions(accessor)[:, :2]
        uv.append(own * moved.get("scale", [1, 1]) + moved.get("offset", [0, 0]))
        corners.append(count + F)
        count += len(own)
    return Skin(np.concatenate(uv), np.concatenate(corners), np.concatenate(material), materials)


def _material(gltf: Gltf, one: dict[str, Any]) -> Material:
    info = one.get("pbrMetallicRoughness", {})
    colour = srgb(np.array(info.get("baseColorFactor", [1.0, 1.0, 1.0, 1.0])[:3], dtype=np.float64))
    if "baseColorTexture" not in info:
        return Material(colour)
    texture = gltf.tree["textures"][info["baseColorTexture"]["index"]]
    webp = texture.get("extensions", {}).get("EXT_texture_webp", {})
    number = webp.get("source", texture.get("source"))
    if number is None:  # of a format that only an extension knows
        return Material(colour)
    return Material(colour, partial(_image, gltf, gltf.tree["images"][number]))


def _image(gltf: Gltf, image: dict[str, Any]) -> bytes:
    if "bufferView" in image:
        view = gltf.tree["bufferViews"][image["bufferView"]]
        begin = view.get("byteOffset", 0)
        return bytes(gltf.buffers[view["buffer"]][begin : begin + view["byteLength"]])
    uri = image["uri"]
    if is_embedded(uri):
        head, _, body = uri.partition(",")
        return base64.b64decode(body) if head.endswith(";base64") else unquote_to_bytes(body)
    return beside(gltf.source, unquote(uri)).read_bytes()

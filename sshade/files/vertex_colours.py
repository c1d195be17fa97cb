"""Colours of the vertices of mesh files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sshade.files.gltf import shown_primitives
from sshade.files.gltf_scene import accessor_bytes
from sshade.files.materials import srgb
from sshade.files.numbers_in_text import key_of
from sshade.files.obj import words_of
from sshade.files.ply import parsed
from sshade.mesh.surface import Surface

#: Names of the colours of vertices in PLY files.
_PLY = ("red green blue", "r g b", "diffuse_red diffuse_green diffuse_blue")


def colours_of(path: Path) -> np.ndarray | None:
    """Return the colours (n, 3) of the vertices of a file, float64 in sRGB from 0 to 1.

    None if not all vertices have a colour, and for .off, .stl and further formats, whose colours are not
    read.
    """
    readers = {".ply": _of_ply, ".obj": _of_obj, ".glb": _of_gltf, ".gltf": _of_gltf}
    reader = readers.get(path.suffix.lower())
    return None if reader is None else reader(path)


def colours_on(path: Path, surface: Surface) -> np.ndarray | None:
    """Return the colours (n, 3) uint8 of the vertices of the surface in a file, or None; see above.

    A vertex that a seam doubles has the colour of its first copy.
    """
    if (colours := colours_of(path)) is None:
        return None
    return (255 * colours[surface.original].clip(0, 1)).round().astype(np.uint8)


def _of_ply(path: Path) -> np.ndarray | None:
    """Whole numbers are parts of the largest number of their type."""
    vertices = parsed(path.read_bytes()).elements["vertex"]
    properties = next(filter(None, map(vertices.numbers, _PLY)), None)
    if properties is None:
        return None
    kinds = [vertices.properties[i].kind for i in properties]
    return vertices.columns(properties) / [np.iinfo(kind).max if kind.kind in "iu" else 1.0 for kind in kinds]


def _of_obj(path: Path) -> np.ndarray | None:
    """Some programs write numbers from 0 to 255."""
    text, key = words_of(path.read_bytes())
    vertices = np.flatnonzero(key == key_of(b"v"))
    if not (text.size[vertices] >= 7).all():
        return None
    colours = text.vectors(vertices, 4, "a colour").value
    return colours / 255 if colours.max() > 1 else colours


def _of_gltf(path: Path) -> np.ndarray | None:
    """Parts without colours are white."""
    gltf, _, shown = shown_primitives(path)
    found: dict[tuple, np.ndarray | None] = {}
    sizes: list[int] = []
    for primitive, _, _ in shown:
        attributes = primitive["attributes"]
        key = accessor_bytes(gltf.tree, attributes["POSITION"])
        if key not in found:
            sizes.append(gltf.tree["accessors"][attributes["POSITION"]]["count"])
            own = attributes.get("COLOR_0")
            found[key] = None if own is None else gltf.fractions(own)[:, :3]
    if all(one is None for one in found.values()):
        return None
    rows = [np.ones((n, 3)) if one is None else one for n, one in zip(sizes, found.values(), strict=True)]
    return srgb(np.concatenate(rows))

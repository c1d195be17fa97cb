"""Materials of OBJ files: the colours and textures of their .mtl files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sshade.files.libraries import rest_of, texture_name
from sshade.files.materials import Material, Skin
from sshade.files.mesh_file import beside
from sshade.files.numbers_in_text import key_of
from sshade.files.obj import faces_of, words_of

#: Colour of faces without a material.
_PLAIN = Material(np.full(3, 0.8))


def obj_skin(path: Path) -> Skin:
    """Return the materials of an OBJ file.

    Raises
    ------
    ValueError
        When texture coordinates are no numbers.
    """
    data = path.read_bytes()  # with its comments: names may have a "#"
    text, key = words_of(data)
    vertices, shading, polygons, coordinates, uses, libraries = (
        np.flatnonzero(key == key_of(word)) for word in (b"v", b"vn", b"f", b"vt", b"usemtl", b"mtllib")
    )
    _, triangles, face, texture = faces_of(text, polygons, vertices, shading)
    uv = np.zeros((1, 2))  # for corners without texture coordinates
    corner = np.zeros(len(face), dtype=np.int64)
    there = texture[0] < texture[1]
    if len(coordinates) and there.any():
        begin = text.first[coordinates] + 1
        uv = np.concatenate([uv, text.numbers(begin[:, None] + np.arange(2)).value * [1, -1] + [0, 1]])
        number = text.integers(*texture[:, there])
        above = np.searchsorted(coordinates, polygons)[face[there]]
        number += np.where(number < 0, above + 1, 0)
        corner[there] = np.where((number > 0) & (number < len(uv)), number, 0)

    def names(lines: np.ndarray) -> list[tuple[str, str]]:
        ends = np.stack(text.line_ends(lines)).T.tolist()
        return [(rest_of(data[a:b]), rest_of(data[a:b].partition(b"#")[0])) for a, b in ends]

    known: dict[str, Material] = {}
    for whole, short in names(libraries):
        for name in dict.fromkeys((*short.split(), short, whole)):
            known |= _library(beside(path, name))
    materials = [_PLAIN, *(known.get(whole, known.get(short, _PLAIN)) for whole, short in names(uses))]
    of_polygon = np.searchsorted(uses, polygons)
    return Skin(uv, corner[triangles], of_polygon[face[triangles[:, 0]]], materials)


def _library(path: Path) -> dict[str, Material]:
    """Return the materials of a .mtl file by their names; none if the file cannot be read."""
    found: dict[str, Material] = {}
    name = None
    try:
        lines = path.read_text(encoding="utf-8-sig", errors="surrogateescape").splitlines()
    except (OSError, ValueError):
        return found
    for line in lines:
        key, *words = line.split() or [""]
        if key == "newmtl":
            name = line.strip().removeprefix(key).strip()
            found[name] = _PLAIN
        elif name is None:
            continue
        elif key == "Kd" and found[name].texture is None:
            try:
                found[name] = Material(np.array([float(word) for word in words[:3]]).clip(0, 1))
            except ValueError:  # a spectral curve
                continue
        elif key == "map_Kd" and (file := texture_name(words)):
            # Exporters write any colour beside a texture; viewers ignore it.
            found[name] = Material(np.ones(3), beside(path, file).read_bytes)
    return found

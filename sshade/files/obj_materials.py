"""Materials of OBJ files: the colours and textures of their .mtl files."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from sshade.files.skins import Material, Skin, require_image
from sshade.files.words import Text

#: How lines of a .mtl file with a texture begin.
_MAPS = ("map_", "bump", "disp", "decal", "refl", "norm")
#: Colour of faces without a material.
_PLAIN = Material(np.full(3, 0.8))


def obj_skin(
    text: Text,
    data: bytes,
    path: Path,
    *,
    polygons: np.ndarray,
    face: np.ndarray,
    texture: np.ndarray,
    triangles: np.ndarray,
    coordinates: np.ndarray,
    uses: np.ndarray,
    libraries: np.ndarray,
) -> Skin:
    """Return the materials of an OBJ file.

    Parameters
    ----------
    text : Text
    data : bytes
        The text with its comments: names may have a ``#``.
    path : path
        The OBJ file; the names of .mtl files are relative to its folder.
    polygons, coordinates, uses, libraries : (k,) int64
        Lines ``f``, ``vt``, ``usemtl`` and ``mtllib``.
    face : (c,) int64
        Polygon of each corner.
    texture : (2, c) int64
        Bytes where the number of each corner's texture coordinates begins and ends.
    triangles : (m, 3) int64
        Numbers of corners.

    Raises
    ------
    ValueError
        When texture coordinates are no numbers.
    """
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
            known |= _library(path.parent / name)
    materials = [_PLAIN, *(known.get(whole, known.get(short, _PLAIN)) for whole, short in names(uses))]
    of_polygon = np.searchsorted(uses, polygons)
    return Skin(uv, corner[triangles], of_polygon[face[triangles[:, 0]]], materials)


def rest_of(line: bytes) -> str:
    """Return what follows the keyword of a line."""
    rest = line.split(None, 1)[1:]
    return rest[0].strip().decode("utf-8", "surrogateescape") if rest else ""


def files_of(name: str, source: Path) -> list[str]:
    """Return the name of a .mtl file and the names of its textures that are there, as from `source`."""
    library = source.parent / name
    lines = library.read_text("utf-8", "surrogateescape").splitlines() if library.is_file() else []
    words = [line.split() for line in lines if line.strip().lower().startswith(_MAPS)]
    textures = [f"{Path(name).parent / _file_name(rest).replace(chr(92), '/')}" for _, *rest in words]
    return [name, *(file for file in dict.fromkeys(textures) if (source.parent / file).is_file())]


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
        elif key == "map_Kd" and (file := _file_name(words)):
            # Exporters write any colour beside a texture; viewers ignore it.
            image = path.parent / file.replace("\\", "/")
            found[name] = Material(np.ones(3), partial(_image, image))
    return found


def _image(path: Path) -> bytes:
    return require_image(path.read_bytes())


def _file_name(words: list[str]) -> str:
    """Return the file name behind the options of a texture, such as ``-s 1 1 1``."""
    while words and words[0].startswith("-"):
        words = words[1:]
        while len(words) > 1 and (words[0] in ("on", "off") or _is_number(words[0])):
            words = words[1:]
    return " ".join(words)


def _is_number(word: str) -> bool:
    return word.replace(".", "", 1).lstrip("+-").isdecimal()

"""OBJ files: positions and normals change, all other lines stay.

Vertices are never split by texture coordinates, normals, colours, groups or materials.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np

from sshade.files.libraries import library_files, library_names, moved_library
from sshade.files.mesh_file import MeshFile, beside, fanned, present
from sshade.files.numbers_in_text import Edits, Text, edited, key_of, without_comments
from sshade.files.obj_normals import Corners, Obj, turned_normals

#: The beginning of a surface object of the Montreal Neurological Institute: its reflectance and its size, as
#: text or binary.
_MNI = re.compile(rb"P(\s+[-+.\deE]+){5}\s+\d+\s|p.{20}\0", re.DOTALL)


def read_obj(path: Path) -> MeshFile:
    """Read an OBJ file.

    Raises
    ------
    ValueError
        On a vertex, a normal or a face that is not complete.
    """
    data = path.read_bytes()
    if _MNI.match(data):
        raise ValueError("it is a surface object of the MNI, not of Wavefront; convert it to another format")
    text, key = words_of(data)
    vertices, shading, polygons, libraries = (
        np.flatnonzero(key == key_of(word)) for word in (b"v", b"vn", b"f", b"mtllib")
    )
    positions = text.vectors(vertices, 1, "a vertex")
    normals = text.vectors(shading, 1, "a normal")
    corners, triangles, face, _ = faces_of(text, polygons, vertices, shading)
    titles = np.flatnonzero((key == key_of(b"o")) | (key == key_of(b"g")))
    first = np.searchsorted(face[triangles[:, 0]], np.searchsorted(polygons, titles)).tolist()
    names = [b" ".join(text.words(line)[1:]).decode("utf-8", "replace") for line in titles.tolist()]
    parts = tuple(zip(first, names, strict=True))
    keys = set(np.unique(key).tolist())
    known = (b"vt", b"mtllib", b"usemtl", b"g", b"o", b"s", b"l", b"p", b"vp", b"curv", b"curv2", b"surf")
    there = {name for name in known if key_of(name) in keys}
    holds = present(
        texture_coordinates=b"vt" in there,
        normals=len(normals.value),
        vertex_colours=(text.size[vertices] >= 7).any(),
        materials=there & {b"mtllib", b"usemtl"},
        groups=there & {b"g", b"o"},
        smoothing_groups=b"s" in there,
        polygons=(text.size[polygons] > 4).any(),
        lines_and_points=there & {b"l", b"p"},
        free_form_curves_and_surfaces=there & {b"vp", b"curv", b"curv2", b"surf"},
        comments=b"#" in data,
    )
    places = np.stack(text.line_ends(libraries))
    lines = [data[a:b] for a, b in places.T.tolist()]
    named = tuple(file for line in lines for file in library_files(line, path))
    used = [name for line in lines for name in library_names(line)]
    obj = Obj(data, positions, normals, corners, triangles, places, text.newline.decode())
    F, content = corners.vertex[triangles], partial(_content, obj, path)
    missing = [name for name in used if not beside(path, name).is_file()]
    notes = tuple(f"its material file {name} is not there" for name in missing)
    V = positions.value
    return MeshFile(V, F, holds, (".obj",), content, notes, source=path, named=named, parts=parts)


def words_of(data: bytes) -> tuple[Text, np.ndarray]:
    """Return the words of a file without comments, and the keys of its lines."""
    joined = without_comments(data)
    if b"\\" in joined:  # a line that ends with a backslash goes on in the next line
        joined = joined.replace(b"\\\r\n", b"   ").replace(b"\\\n", b"  ").replace(b"\\\r", b"  ")
    text = Text(joined)
    return text, text.keys()


def faces_of(
    text: Text, faces: np.ndarray, vertex_lines: np.ndarray, normal_lines: np.ndarray
) -> tuple[Corners, np.ndarray, np.ndarray, np.ndarray]:
    """Read the faces from their lines.

    Returns
    -------
    corners : Corners
    triangles : (m, 3) int64
        Numbers of corners.
    face : (c,) int64
        Number of the polygon of each corner.
    texture : (2, c) int64
        Bytes where the number of each corner's texture coordinates begins and ends.
    """

    def require(wrong: np.ndarray, lines: np.ndarray, message: str) -> None:
        if wrong.any():
            raise ValueError(f"line {text.line_number(lines[wrong][0])}: {message}")

    sizes = text.size[faces] - 1
    incomplete = "a face needs three vertices, counted from 1"
    require(sizes < 3, faces, incomplete)
    first = np.cumsum(sizes) - sizes
    of_size = [np.flatnonzero(sizes == size) for size in np.unique(sizes)]
    polygons = [first[polygon, None] + np.arange(sizes[polygon[0]]) for polygon in of_size]
    face = np.repeat(np.arange(len(sizes)), sizes)
    line = faces[face]
    words = np.arange(len(face)) + (text.first[faces] + 1 - first)[face]
    begin, end = text.begin[words], text.end[words]
    slashes = np.append(np.flatnonzero(np.frombuffer(text.data, np.uint8) == ord("/")), [len(text.data)] * 3)
    slash = np.searchsorted(slashes, begin)
    vertex = text.integers(begin, np.minimum(slashes[slash], end))
    texture = np.stack([slashes[slash] + 1, np.minimum(slashes[slash + 1], end)])
    begin, end = np.minimum(slashes[slash + 1] + 1, end), np.minimum(slashes[slash + 2], end)
    shaded = begin < end
    number = np.zeros(len(begin), dtype=np.int64)
    number[shaded] = text.integers(begin[shaded], end[shaded])
    require((vertex == 0) | (shaded & (number == 0)), line, incomplete)
    above = np.searchsorted(vertex_lines, faces)[face]
    require(vertex < -above, line, "a face refers to more vertices than there are above it")
    vertex += np.where(vertex > 0, -1, above)
    normal = number + np.where(number < 0, np.searchsorted(normal_lines, faces)[face], -1)
    normal[(normal < 0) | (normal >= len(normal_lines))] = -1
    corners = Corners(vertex, normal, begin, end, number)
    return corners, fanned(polygons, of_size)[0], face, texture


def _content(obj: Obj, source: Path, V: np.ndarray, path: Path) -> bytes:
    edits = [obj.positions.edits(V)]
    if len(obj.normals.value):
        edits += turned_normals(obj, V)
    lines = [moved_library(obj.data[a:b], source, path) for a, b in obj.libraries.T.tolist()]
    edits.append(Edits(obj.libraries[0], obj.libraries[1], [line.decode("latin-1") for line in lines]))
    return edited(obj.data, edits)

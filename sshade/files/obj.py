"""OBJ files: positions and normals change, all other lines stay.

Vertices are never split by texture coordinates, normals, colours, groups or materials.
"""

from __future__ import annotations

from functools import partial
from os.path import isfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sshade.files.mesh_file import MeshFile, moved_reference, present
from sshade.files.normals import smooth_groups, turned, turns
from sshade.files.obj_materials import obj_skin, rest_of
from sshade.files.skins import Skin
from sshade.files.triangles import fanned
from sshade.files.words import Edits, Numbers, Text, edited, key_of, without_comments
from sshade.mesh.seams import same_rows

#: Decimal places of written normals.
DECIMALS = 6


class _Corners(NamedTuple):
    """Corners of all polygons, (c,) arrays in the order of the file.

    Attributes
    ----------
    vertex, normal : int64
        Ids from 0; -1 for a corner without a normal, or whose normal the file does not declare.
    begin, end : int64
        Places where the number of the corner's normal begins and ends.
    number : int64
        Number of the normal in the file, from 1, or from -1 backwards from the face; 0 for no number.
    """

    vertex: np.ndarray
    normal: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    number: np.ndarray


class _Obj(NamedTuple):
    """An OBJ file.

    Attributes
    ----------
    data : bytes
    positions, normals : Numbers
    normal_lines : (k,) int64
        Byte where the line of each normal begins.
    corners : _Corners
    triangles : (m, 3) int64
        Numbers of corners.
    libraries : (2, l) int64
        Bytes where lines "mtllib" and the lines behind them begin.
    """

    data: bytes
    positions: Numbers
    normals: Numbers
    normal_lines: np.ndarray
    corners: _Corners
    triangles: np.ndarray
    libraries: np.ndarray


def read_obj(path: Path) -> MeshFile:
    """Read an OBJ file.

    Raises
    ------
    ValueError
        On a vertex, a normal or a face that is not complete.
    """
    data = path.read_bytes()
    text, key = _words(data)
    vertices, shading, polygons, libraries = (
        np.flatnonzero(key == key_of(word)) for word in (b"v", b"vn", b"f", b"mtllib")
    )
    positions = text.vectors(vertices, 1, "a vertex")
    normals = text.vectors(shading, 1, "a normal")
    corners, triangles, _, texture = _faces(text, polygons, vertices, shading)
    keys = set(np.unique(key).tolist())
    known = (b"vt", b"mtllib", b"usemtl", b"g", b"o", b"s", b"l", b"p", b"vp", b"curv", b"curv2", b"surf")
    there = {name for name in known if key_of(name) in keys}
    textured = int((texture[0] < texture[1]).sum())
    undeclared = int(((corners.number != 0) & (corners.normal < 0)).sum())
    stay = "that it does not declare stay as they are"
    notes = {
        f"references of faces to normals {stay}: {undeclared}": undeclared,
        f"references of faces to texture coordinates {stay}: {textured}": textured and b"vt" not in there,
    }
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
    obj = _Obj(data, positions, normals, text.line_ends(shading)[0], corners, triangles, places)
    F, content = corners.vertex[triangles], partial(_content, obj, path)
    coloured = bool((text.size[vertices] >= 7).all())
    return MeshFile(
        positions.value,
        F,
        holds,
        (".obj",),
        content,
        tuple(n for n, there in notes.items() if there),
        colours=partial(_colours, text, vertices) if coloured else None,
        skin=partial(_skin, data, path) if there >= {b"mtllib", b"usemtl"} else None,
    )


def _words(data: bytes) -> tuple[Text, np.ndarray]:
    """Return the words of a file without comments, and the keys of its lines."""
    joined = without_comments(data)
    if b"\\" in joined:  # a line that ends with a backslash goes on in the next line
        joined = joined.replace(b"\\\r\n", b"   ").replace(b"\\\n", b"  ")
    text = Text(joined)
    return text, text.keys()


def _skin(data: bytes, path: Path) -> Skin:
    """Return the materials of a file; its words are read again, because few callers need materials."""
    text, key = _words(data)
    vertices, shading, polygons, coordinates, uses, libraries = (
        np.flatnonzero(key == key_of(word)) for word in (b"v", b"vn", b"f", b"vt", b"usemtl", b"mtllib")
    )
    _, triangles, face, texture = _faces(text, polygons, vertices, shading)
    lines = {"polygons": polygons, "coordinates": coordinates, "uses": uses, "libraries": libraries}
    return obj_skin(text, data, path, **lines, face=face, texture=texture, triangles=triangles)


def _colours(text: Text, vertices: np.ndarray) -> np.ndarray:
    """Return colours (n, 3) from 0 to 1. Some programs write numbers from 0 to 255."""
    colours = text.vectors(vertices, 4, "a colour").value
    return colours / 255 if colours.max() > 1 else colours


def _faces(
    text: Text, faces: np.ndarray, vertex_lines: np.ndarray, normal_lines: np.ndarray
) -> tuple[_Corners, np.ndarray, np.ndarray, np.ndarray]:
    """Read the faces from their lines.

    Returns
    -------
    corners : _Corners
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
    corners = _Corners(vertex, normal, begin, end, number)
    return corners, fanned(polygons, of_size)[0], face, texture


def _content(obj: _Obj, source: Path, V: np.ndarray, path: Path) -> bytes:
    edits = [obj.positions.edits(V)]
    if len(obj.normals.value):
        edits += _turned_normals(obj, V)
    lines = [_moved_library(obj.data[a:b], source, path) for a, b in obj.libraries.T.tolist()]
    edits.append(Edits(obj.libraries[0], obj.libraries[1], [line.decode("latin-1") for line in lines]))
    return edited(obj.data, edits)


def _moved_library(line: bytes, source: Path, path: Path) -> bytes:
    """Convert the names of a line "mtllib" so that they are valid in `path`."""
    written = line if isfile(source.parent / rest_of(line)) else line.partition(b"#")[0]
    text = rest_of(written)
    # Names are separated by blanks, but a single name may contain blanks.
    single = isfile(source.parent / text) or text.lower().count(".mtl") == 1
    names = [text] if single else text.split()
    moved = [moved_reference(name, source, path) for name in names]
    if moved == names:
        return line
    kept = line[len(written.rstrip()) :]
    return b"mtllib " + " ".join(moved).encode("utf-8", "surrogateescape") + kept


def _turned_normals(obj: _Obj, V: np.ndarray) -> list[Edits]:
    """Turn normals with the surface.

    Programs write equal normals once. Where the vertices that share a normal turn differently, further
    lines precede the line of the normal, and the faces are numbered anew.
    """
    corners, rest, N = obj.corners, obj.positions.value, obj.normals.value
    shaded = np.flatnonzero(corners.normal >= 0)
    if not len(shaded):
        return []
    pair_of, vertex, normal = _pairs(corners.vertex[shaded], corners.normal[shaded], len(rest))
    alike, one = smooth_groups(V[vertex], N[normal])
    group = np.full(len(corners.vertex), -1)
    group[shaded] = alike[pair_of]
    Q = turns(group[obj.triangles], N[normal[one]], corners.vertex[obj.triangles], rest, V)
    new = turned(Q[alike], N[normal])
    unchanged = ((new == N[normal]) | np.isnan(new)).all(axis=1)
    new = np.where(unchanged[:, None], N[normal], np.round(new, DECIMALS) + 0.0)
    variant = same_rows(np.column_stack([normal, new]))
    _, one = np.unique(variant, return_index=True)
    order = np.argsort(normal[one], kind="stable")  # the order in which variants are written
    line_of, value = normal[one][order], new[one][order]
    written = np.bincount(line_of, minlength=len(N))
    edits = _variants(obj, line_of, value)
    if (written > 1).any():
        above = np.append(0, np.cumsum(np.maximum(written, 1)))  # new lines above each normal
        rank = np.arange(len(order)) - np.searchsorted(line_of, line_of)
        place = np.empty(len(order), dtype=np.int64)
        place[order] = above[line_of] + rank
        # Numbers that count backwards from the face keep doing so. Numbers without a normal stay without one.
        number = corners.number
        new = number + np.sign(number) * (above[-1] - len(N))
        base = (corners.normal - number)[shaded]  # the normals above the face, or -1
        new[shaded] = place[variant[pair_of]] - np.where(base < 0, -1, above[base])
        numbered = number != 0
        numbers = Numbers(corners.begin[numbered], corners.end[numbered], number[numbered])
        edits.append(numbers.edits(new[numbered]))
    return edits


def _pairs(vertex: np.ndarray, normal: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Collect the distinct pairs of a vertex and a normal.

    Returns
    -------
    pair : (c,) int64
        Pair of each corner.
    vertex, normal : (p,) int64
        Members of each pair.
    """
    last = np.full(n, -1)
    last[vertex] = normal
    if (last[vertex] == normal).all():  # each vertex has one normal, the usual case
        used = last >= 0
        return (np.cumsum(used) - 1)[vertex], np.flatnonzero(used), last[used]
    pair = same_rows(np.column_stack([vertex, normal]))
    _, one = np.unique(pair, return_index=True)
    return pair, vertex[one], normal[one]


def _variants(obj: _Obj, line_of: np.ndarray, value: np.ndarray) -> list[Edits]:
    """Write normals (w, 3) to their lines (w,), ascending. Only the last normal of a line replaces it."""
    last = np.append(line_of[1:] != line_of[:-1], True)
    in_place = Numbers(*(column[line_of[last]] for column in obj.normals)).edits(value[last])
    line_end = "\r\n" if b"\r\n" in obj.data else "\n"
    further = [f"vn {x!r} {y!r} {z!r}{line_end}" for x, y, z in value[~last].tolist()]
    begin = obj.normal_lines[line_of[~last]]
    return [Edits(begin, begin, further), in_place]

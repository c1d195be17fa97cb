"""PLY files: positions and normals change, all other numbers stay.

Libraries change meshes while they read them. This reader refuses text files that end early, splits no
vertices at texture seams, and opens no other file that the header names.

G. Turk, "The PLY polygon file format", 1994.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sshade.core.errors import counted
from sshade.files.mesh_file import MeshFile, fanned, moved_reference, present, strip_triangles, unchanged
from sshade.files.numbers_in_text import Numbers, Text, edited
from sshade.files.ply_elements import Element, copy_rows, declared_words, read_header, take
from sshade.mesh.normals import turned, turns, vertex_turns
from sshade.mesh.surface import as_single, single_steps

_CORNERS = ("vertex_indices", "vertex_index")
NORMALS = ("nx ny nz", "normal_x normal_y normal_z")
_CHANGED = ["x", "y", "z", *" ".join(NORMALS).split()]


#: An element, the numbers of its properties that change, and their new values (rows, k).
Change = tuple[Element, list[int], np.ndarray]


class Ply(NamedTuple):
    """A PLY file.

    Attributes
    ----------
    data : bytes
    body : int
        Place where the header ends and the numbers begin.
    order : str
        Byte order of the numbers: "<", ">", or "" for text.
    elements : dict
        Elements by name. In a text, places of rows count eight bytes for each word.
    words : Numbers, optional
        All declared numbers of a text; places count from `body`.
    notes : tuple of str
    """

    data: bytes
    body: int
    order: str
    elements: dict[str, Element]
    words: Numbers | None
    notes: tuple[str, ...]


def read_ply(path: Path) -> MeshFile:
    """Read a PLY file, text or binary. A file that holds points only has no triangles.

    Raises
    ------
    ValueError
        When the file is no PLY file, holds fewer or more numbers than it announces, or has no positions.
    """
    ply = parsed(path.read_bytes())
    if "vertex" not in ply.elements:
        raise ValueError("it has no vertices")
    vertices, faces = ply.elements["vertex"], ply.elements.get("face")
    at = vertices.numbers("x y z")
    if not at:
        raise ValueError("its vertices have no x, y and z")
    V = vertices.columns(at)
    F, face = _triangles(faces) if faces else fanned([], [])
    if "tristrips" in ply.elements:
        F = np.concatenate([F, _strips(ply.elements["tristrips"])])
        face = np.concatenate([face, np.full(len(F) - len(face), -1)])
    properties = vertices.properties + (faces.properties if faces else [])
    # Positions and normals that are whole numbers cannot be written back after a deformation.
    whole = any(p.kind.kind != "f" for p in properties if p.name in _CHANGED)
    suffixes = () if whole else (".ply",)
    kinds = {vertices.properties[number].kind.type for number in at}
    single = kinds == {np.float32}
    content = partial(_content, ply, V, F, face, path)
    rounding = single_steps(V) if single and not ply.words else None  # a text is exact
    holds = _holds(ply, int((face >= 0).sum()))
    stored = unchanged if ply.words or kinds == {np.float64} else as_single if single else None
    named = tuple(name for _, name in _texture_files(ply.data[: ply.body].splitlines()))
    return MeshFile(V, F, holds, suffixes, content, ply.notes, rounding, stored, path, named)


def parsed(data: bytes) -> Ply:
    """Read the elements of a PLY file from its bytes; raise ValueError as :func:`read_ply`."""
    order, elements, body = read_header(data)
    numbers, at, words = data, body, None
    notes: tuple[str, ...] = ()
    if order == "":
        text = Text(data[body:], above=len(data[:body].splitlines()))
        declared: np.ndarray | slice = slice(None)
        if len(text.first) == sum(element.size for element in elements if element.properties):
            declared, notes = declared_words(text, elements)
        words = text.numbers(declared)
        numbers, at = words.value.astype("<f8").tobytes(), 0
    for element in elements:
        element.rows, at = take(numbers, at, element, order)
    if at != len(numbers):
        raise ValueError("more numbers follow after the last announced row")
    return Ply(data, body, order, {element.name: element for element in elements}, words, notes)


def _triangles(faces: Element) -> tuple[np.ndarray, np.ndarray]:
    """Return the triangles (m, 3) of the element "face", and the number of the face (m,) of each."""
    polygons = _vertex_ids(faces)
    small = min((ids.shape[1] for ids in polygons), default=3)
    if small < 3:
        raise ValueError(f"a face has {counted(small, 'corner', 'corners')}")
    return fanned(polygons, [np.arange(faces.size)[rows.which] for rows in faces.rows])


def _strips(element: Element) -> np.ndarray:
    """Return the triangles (m, 3) of the element "tristrips", as scans of Stanford have."""
    rows = [np.insert(ids, ids.shape[1], -1, axis=1).ravel() for ids in _vertex_ids(element)]
    return strip_triangles(np.concatenate([np.zeros(0, dtype=np.int64), *rows]))


#: Properties of vertices and faces by their meaning.
_MEANING = {
    "normals": _CHANGED[3:],
    "colours": ["red", "green", "blue", "alpha", "r", "g", "b", "a", "diffuse_red", "diffuse_green"]
    + ["diffuse_blue"],
    "texture coordinates": ["s", "t", "u", "v", "texture_u", "texture_v", "texcoord", "texnumber"],
}


def _holds(ply: Ply, triangles: int) -> tuple[str, ...]:
    """Return the names of the contents besides positions and triangles."""
    found = []
    for element in ply.elements.values():
        if element.name not in ("vertex", "face"):
            found.append("triangle strips" if element.name == "tristrips" else f"element {element.name}")
            continue
        for name in [p.name for p in element.properties]:
            if name not in ("x", "y", "z", *_CORNERS):
                known = next((meaning for meaning, names in _MEANING.items() if name in names), None)
                found.append(known or f"property {name}")
                if known in ("normals", "colours"):
                    found[-1] = f"{element.name} {known}"
    faces = ply.elements.get("face")
    header = [line.split()[:1] for line in ply.data[: ply.body].splitlines()]
    named = present(
        undeclared_values=ply.notes,
        polygons=faces is not None and triangles > faces.size,
        comments=[b"comment"] in header or [b"obj_info"] in header,
    )
    return tuple(dict.fromkeys(found)) + named


def _content(
    ply: Ply, rest: np.ndarray, F: np.ndarray, face: np.ndarray, source: Path, V: np.ndarray, path: Path
) -> bytes | memoryview:
    vertices = ply.elements["vertex"]
    changes = [(vertices, vertices.numbers("x y z"), V)]
    faces = ply.elements.get("face")
    for names in NORMALS:
        if normals := vertices.numbers(names):
            N = vertices.columns(normals)
            changes.append((vertices, normals, turned(vertex_turns(N, F, rest, V), N)))
        if faces and len(F) and (normals := faces.numbers(names)):
            N = faces.columns(normals)
            Q = turns(np.repeat(face[:, None], 3, axis=1), N, F, rest, V)  # one rotation per face
            changes.append((faces, normals, turned(Q, N)))
    header = _header_at(ply.data[: ply.body], source, path)
    return header + _patched_text(ply, ply.words, changes) if ply.words else _patched(ply, changes, header)


def _patched(ply: Ply, changes: list[Change], header: bytes) -> memoryview:
    content = np.empty(len(header) + len(ply.data) - ply.body, dtype=np.uint8)
    content[: len(header)] = np.frombuffer(header, np.uint8)
    every = content[len(header) :]
    copy_rows(every, np.frombuffer(ply.data, np.uint8)[ply.body :])
    for element, properties, new in changes:
        for column, i in enumerate(properties):
            kind = np.dtype(ply.order + element.properties[i].kind.char)
            for rows in element.rows:
                if isinstance(rows.which, slice):
                    values = every[rows.begin - ply.body :][: rows.values.nbytes].view(rows.values.dtype)
                    copy_rows(values[f"p{i}"], new[:, column])
                    continue
                values = new[rows.which, column].astype(kind).view(np.uint8).reshape(-1, kind.itemsize)
                every[rows.places(i)[:, None] - ply.body + np.arange(kind.itemsize)] = values
    return content.data


def _patched_text(ply: Ply, words: Numbers, changes: list[Change]) -> bytes:
    edits = []
    for element, properties, new in changes:
        for rows in element.rows:
            places = np.stack([rows.places(i) // 8 for i in properties], axis=1)
            edits.append(Numbers(*(column[places] for column in words)).edits(new[rows.which]))
    return edited(ply.data[ply.body :], edits)


def _header_at(header: bytes, source: Path, path: Path) -> bytes:
    """Return a header in which the names of texture files, in comments, are valid in `path`."""
    lines = header.splitlines(keepends=True)
    for number, name in _texture_files(lines):
        old, new = (
            text.encode("utf-8", "surrogateescape") for text in (name, moved_reference(name, source, path))
        )
        lines[number] = lines[number].replace(old, new)
    return b"".join(lines)


def _texture_files(lines: list[bytes]) -> list[tuple[int, str]]:
    """Return the numbers of the lines of a header that name a texture, and the names."""
    words = [(number, line.split(None, 2)) for number, line in enumerate(lines)]
    return [
        (number, parts[2].strip().decode("utf-8", "surrogateescape"))
        for number, parts in words
        if parts[:2] == [b"comment", b"TextureFile"] and len(parts) == 3
    ]


def write_ply(path: Path, V: np.ndarray, F: np.ndarray) -> None:
    """Write positions (n, 3) and faces (m, 3) as a binary PLY file with float64 positions."""
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(V)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {len(F)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(F), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"] = 3
    faces["corners"] = F
    with path.open("wb") as file:
        file.write(header.encode("ascii"))
        file.write(np.ascontiguousarray(V, dtype="<f8").tobytes())
        file.write(faces.tobytes())


def _vertex_ids(element: Element) -> list[np.ndarray]:
    """Return the lists of vertices (r, k) int64 of an element, for each group of rows of one length."""
    corners = [i for i, p in enumerate(element.properties) if p.name in _CORNERS and p.length is not None]
    if element.size and len(corners) != 1:
        raise ValueError(f"its element {element.name} has no list vertex_indices")
    found = [rows.values[f"p{corners[0]}"] for rows in element.rows]
    for ids in found:
        if ids.dtype.kind == "f" and not ((np.abs(ids) < 2**53) & (np.trunc(ids) == ids)).all():
            raise ValueError("a corner of a face is no whole number, or too large")
    return [copy_rows(np.empty(ids.shape, dtype=np.int64), ids) for ids in found]

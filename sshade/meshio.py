"""Reading and writing meshes; the order of vertices and faces is kept exactly."""

from __future__ import annotations

import os
from itertools import pairwise
from pathlib import Path

import numpy as np

from sshade.errors import InputError
from sshade.files import replacing
from sshade.mesh import Mesh
from sshade.ply import read_ply, write_ply

#: Formats read and written, by suffix.
SUFFIXES = (".ply", ".obj", ".off", ".stl")


def read_mesh(path: str | os.PathLike[str]) -> Mesh:
    """Read a triangle mesh.

    Parameters
    ----------
    path : path
        A .ply, .obj, .off or .stl file. Polygons with more corners are
        fanned into triangles by the reader; vertices are not merged.

    Raises
    ------
    InputError
        When the file is missing, unreadable, empty, of another format, or
        holds no valid :class:`Mesh`.
    """
    V, F = read_arrays(path)
    try:
        return Mesh(V, F)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def read_arrays(path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a mesh file as they stand there, without validation."""
    path = Path(path)
    _check_suffix(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the file is empty")
    try:
        if path.suffix.lower() == ".ply":
            return read_ply(path)
        if path.suffix.lower() == ".obj":
            return _read_obj(path)
        return _read_by_trimesh(path)
    except InputError:
        raise
    except Exception as error:  # any reader failure is the file's fault, and becomes one sentence
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: not a readable {path.suffix[1:].upper()} file ({reason})") from error


def write_mesh(path: str | os.PathLike[str], V: np.ndarray, F: np.ndarray) -> None:
    """Write a triangle mesh; PLY is binary with float64 positions.

    The file appears whole or not at all.

    Parameters
    ----------
    path : path
        Its suffix picks the format: .ply, .obj, .off or .stl.
    V : (n, 3) float64
    F : (m, 3) int

    Raises
    ------
    InputError
        On an unknown suffix, or a folder that does not exist or is not writable.
    """
    path = Path(path)
    check_output(path)
    with replacing(path) as temporary:
        if path.suffix.lower() == ".ply":
            write_ply(temporary, V, F)
        else:
            import trimesh

            trimesh.Trimesh(V, F, process=False).export(temporary, **_EXPORT.get(path.suffix.lower(), {}))


_EXPORT = {".obj": {"digits": 17, "include_normals": False}, ".off": {"digits": 17}}


def check_output(path: str | os.PathLike[str]) -> None:
    """Raise InputError if a mesh could not be written to `path`; call it before long work."""
    path = Path(path)
    _check_suffix(path)
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist")
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give the name of a file")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"{path}: the folder {path.parent} is not writable")


def repair(V: np.ndarray, F: np.ndarray) -> tuple[Mesh, np.ndarray]:
    """Weld coincident vertices and drop what no mesh needs.

    Vertices at exactly the same position become one (an unwelded soup becomes
    a surface), then repeated-index faces and duplicates of faces go, then
    vertices without a face.

    Returns
    -------
    mesh : Mesh
    vertex : (n,) int
        For each input vertex its vertex in `mesh`, -1 where it has none.
    """
    V = np.asarray(V, dtype=np.float64)
    F = np.asarray(F, dtype=np.int64)
    if len(F) and (F.min() < 0 or F.max() >= len(V)):
        raise InputError(f"faces refer to vertices outside 0..{len(V) - 1}; no repair can mend that")
    _, first, weld = np.unique(V, axis=0, return_index=True, return_inverse=True)
    weld = first[weld.ravel()]
    F = weld[F]
    F = F[(F[:, 0] != F[:, 1]) & (F[:, 1] != F[:, 2]) & (F[:, 2] != F[:, 0])]
    _, keep = np.unique(np.sort(F, axis=1), axis=0, return_index=True)
    F = F[np.sort(keep)]
    used = np.zeros(len(V), dtype=bool)
    used[F] = True
    new_id = np.where(used, np.cumsum(used) - 1, -1)
    return Mesh(V[used], new_id[F]), new_id[weld]


def _check_suffix(path: Path) -> None:
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: unknown mesh format {path.suffix!r}; use one of {', '.join(SUFFIXES)}")


def _read_obj(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Positions and faces; texture coordinates, normals, groups and materials split neither."""
    # trimesh makes one mesh a material, and drops faces that a truncated file leaves unfinished.
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    text = path.read_text(encoding="utf-8", errors="replace").replace("\\\n", " ")
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(word) for word in words[1:4]])
            if len(vertices[-1]) < 3:
                raise ValueError(f"line {number}: a vertex needs three coordinates")
        elif words[:1] == ["f"]:
            ids = [int(word.split("/", 1)[0]) for word in words[1:]]
            if len(ids) < 3 or 0 in ids:
                raise ValueError(f"line {number}: a face needs three vertices, counted from 1")
            ids = [i - 1 if i > 0 else len(vertices) + i for i in ids]
            faces += [(ids[0], b, c) for b, c in pairwise(ids[1:])]
    if not vertices or not faces:
        raise InputError(f"{path}: the file holds no triangles")
    return np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.int64)


def _read_by_trimesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """OFF and STL."""
    import trimesh

    if path.suffix.lower() == ".off":
        _check_off(path)
    loaded = trimesh.load(path, process=False, maintain_order=True)
    if not isinstance(loaded, trimesh.Trimesh):
        geometry = getattr(loaded, "geometry", None)
        if geometry is not None and len(geometry) > 1:
            raise InputError(f"{path}: the file holds {len(geometry)} meshes; give one mesh a file")
        if not geometry or not isinstance(next(iter(geometry.values())), trimesh.Trimesh):
            raise InputError(f"{path}: the file holds no triangles")
        loaded = next(iter(geometry.values()))
    return np.asarray(loaded.vertices, dtype=np.float64), np.asarray(loaded.faces, dtype=np.int64)


def _check_off(path: Path) -> None:
    """Raise ValueError on a truncated file: the reader takes what it finds."""
    rows = [line.split("#", 1)[0].split() for line in path.read_text(encoding="utf-8").splitlines()]
    rows = [row for row in rows if row]
    if not rows or not rows[0][0].upper().endswith("OFF"):
        raise ValueError("it does not begin with OFF")
    counts, body = (rows[0][1:], rows[1:]) if len(rows[0]) > 1 else (rows[1], rows[2:])
    vertices, faces = int(counts[0]), int(counts[1])
    if len(body) < vertices + faces:
        raise ValueError(f"{vertices} vertices and {faces} faces are announced, {len(body)} lines follow")
    last = body[vertices + faces - 1]
    if faces and len(last) <= int(last[0]):
        raise ValueError("the last face is not complete")

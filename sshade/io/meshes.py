"""Reading and writing meshes; the order of vertices and faces is kept exactly."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from sshade.errors import InputError
from sshade.io.decimals import INTEGER, rows_of
from sshade.io.document import MeshFile
from sshade.io.files import check_output, check_suffix, replacing
from sshade.io.gltf import read_gltf, write_gltf
from sshade.io.obj import read_obj
from sshade.io.off import read_off
from sshade.io.ply import read_ply, write_ply
from sshade.io.stl import read_stl
from sshade.mesh.mesh import Mesh, repeats_vertex

_READERS = {
    ".ply": read_ply,
    ".obj": read_obj,
    ".off": read_off,
    ".stl": read_stl,
    ".glb": read_gltf,
    ".gltf": read_gltf,
}
#: Formats read and written, by suffix.
SUFFIXES = tuple(_READERS)


def read_mesh(path: str | os.PathLike[str]) -> Mesh:
    """Read a triangle mesh.

    Parameters
    ----------
    path : path
        A .ply, .obj, .off, .stl, .glb or .gltf file. Polygons with more corners
        are fanned into triangles by the reader; vertices are not merged.

    Raises
    ------
    InputError
        When the file is missing, unreadable, empty, of another format, or
        holds no valid :class:`Mesh`.
    """
    return mesh_of(read_file(path), path)


def mesh_of(file: MeshFile, path: str | os.PathLike[str]) -> Mesh:
    """The mesh that a file holds; an InputError names the file."""
    try:
        return Mesh(file.V, file.F)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def read_arrays(path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a mesh file as they stand there, without validation."""
    file = read_file(path)
    return np.array(file.V), np.array(file.F)


def read_file(path: str | os.PathLike[str]) -> MeshFile:
    """All that a mesh file holds, without validation, to be written again by :func:`write_file`.

    Raises
    ------
    InputError
        When the file is missing, unreadable, empty, or of another format.
    """
    path = Path(path)
    check_suffix(path, SUFFIXES)
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the file is empty")
    try:
        return _READERS[path.suffix.lower()](path)
    except InputError:
        raise
    except Exception as error:  # any reader failure is the file's fault, and becomes one sentence
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: not a readable {path.suffix[1:].upper()} file ({reason})") from error


def write_file(path: str | os.PathLike[str], file: MeshFile, V: np.ndarray) -> None:
    """Write a mesh file as it was read, with other positions; in another format, its mesh alone.

    The file appears whole or not at all. :meth:`MeshFile.lost` tells beforehand what another format
    does not take over.

    Parameters
    ----------
    path : path
        Its suffix picks the format.
    file : MeshFile
    V : (n, 3) float64
        Of its vertices, in their order.

    Raises
    ------
    InputError
        On an unknown suffix, or a folder that does not exist or is not writable.
    """
    path = Path(path)
    check_output(path, SUFFIXES)
    if path.suffix.lower() not in file.suffixes:
        write_mesh(path, V, file.F)
        return
    content = file.content(V, path)
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def write_mesh(path: str | os.PathLike[str], V: np.ndarray, F: np.ndarray) -> None:
    """Write a triangle mesh; PLY is binary with float64 positions.

    The file appears whole or not at all.

    Parameters
    ----------
    path : path
        Its suffix picks the format: .ply, .obj, .off, .stl, .glb or .gltf. The last three hold
        positions as float32.
    V : (n, 3) float64
    F : (m, 3) int

    Raises
    ------
    InputError
        On an unknown suffix, or a folder that does not exist or is not writable.
    """
    path = Path(path)
    check_output(path, SUFFIXES)
    with replacing(path) as temporary:
        if path.suffix.lower() == ".ply":
            write_ply(temporary, V, F)
        elif path.suffix.lower() in (".glb", ".gltf"):
            write_gltf(temporary, np.asarray(V, dtype=np.float64), np.asarray(F))
        elif path.suffix.lower() == ".stl":
            import trimesh

            temporary.write_bytes(trimesh.Trimesh(V, F, process=False).export(file_type="stl"))
        else:
            V, F = np.asarray(V), np.asarray(F)
            head, vertex, face, first = _TEXTS[path.suffix.lower()]
            content = head.format(n=len(V), m=len(F)).encode()
            temporary.write_bytes(content + rows_of(vertex, V) + rows_of(face, F + first, INTEGER))


#: Of formats that are text: the head, what lines of vertices and faces begin with, the first id.
_TEXTS = {".obj": ("", b"v", b"f", 1), ".off": ("OFF\n{n} {m} 0\n", b"", b"3", 0)}


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
    F = F[~repeats_vertex(F)]
    _, keep = np.unique(np.sort(F, axis=1), axis=0, return_index=True)
    F = F[np.sort(keep)]
    used = np.zeros(len(V), dtype=bool)
    used[F] = True
    new_id = np.where(used, np.cumsum(used) - 1, -1)
    return Mesh(V[used], new_id[F]), new_id[weld]

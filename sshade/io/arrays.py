"""Meshes in and out of files as the arrays that libigl, gpytoolbox and trimesh work on."""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np

from sshade.errors import InputError
from sshade.io.document import MeshFile
from sshade.io.meshes import read_arrays, read_file, write_file, write_mesh


class Arrays(NamedTuple):
    """Vertices and triangles.

    Attributes
    ----------
    V : (n, 3) float64
    F : (m, 3) int64
    """

    V: np.ndarray
    F: np.ndarray


def read(path: str | os.PathLike[str]) -> Arrays:
    """Read a mesh file: ``V, F = sshade.read("body.ply")``.

    Nothing is merged, reordered or left out; polygons are fanned into triangles. A
    :class:`sshade.Mesh`, which is checked, is ``Mesh(*sshade.read(path))``.

    Parameters
    ----------
    path : path
        A .ply, .obj, .off, .stl, .glb or .gltf file.

    Returns
    -------
    V : (n, 3) float64
        In the file's order and unit of length.
    F : (m, 3) int64

    Raises
    ------
    InputError
        When the file is missing, unreadable, empty, or of another format.
    """
    return Arrays(*read_arrays(path))


def write(
    path: str | os.PathLike[str],
    mesh: Any,
    F: np.ndarray | None = None,
    *,
    like: str | os.PathLike[str] | MeshFile | None = None,
) -> None:
    """Write a mesh file: ``sshade.write("posed.ply", V, F)``.

    Or the file that a mesh came from, with other positions: ``sshade.write("posed.glb", V,
    like="body.glb")``. Texture coordinates, colours, materials, groups, polygons and all else stay, and
    normals turn along. The file appears whole or not at all.

    Parameters
    ----------
    path : path
        Its suffix picks the format. STL, GLB and glTF hold positions as float32.
    mesh : (n, 3) float64, or an object
        Positions, or what has ``V`` and ``F``, as a :class:`sshade.Mesh`, or ``vertices`` and
        ``faces``, as a trimesh.
    F : (m, 3) int, optional
        With positions and without `like`.
    like : path or MeshFile, optional
        The file to write again: its number and order of vertices, and its format.

    Raises
    ------
    InputError
        Without faces, on arrays of other shapes, or faces out of range; when `like` has another number
        of vertices, or holds what a file at `path` cannot; on an unknown suffix, or a folder that
        does not exist or is not writable.
    """
    V = getattr(mesh, "V", getattr(mesh, "vertices", mesh))
    V = np.asarray(V, dtype=np.float64)
    if like is None:
        F = getattr(mesh, "F", getattr(mesh, "faces", F))
        if F is None:
            raise InputError("there are no faces to write; give them, or with like= the file that has them")
        F = np.asarray(F)
        if V.ndim != 2 or V.shape[1] != 3 or F.ndim != 2 or F.shape[1] != 3:
            raise InputError(f"a mesh has vertices (n, 3) and faces (m, 3), not {V.shape} and {F.shape}")
        if len(F) and (F.min() < 0 or F.max() >= len(V)):
            raise InputError(f"a face refers to vertex {F.max()} or {F.min()} of {len(V)}")
        write_mesh(path, V, F)
        return
    file = like if isinstance(like, MeshFile) else read_file(like)
    if V.shape != file.V.shape:
        raise InputError(
            f"the file to write like has vertices {file.V.shape}, not {V.shape}; they must correspond"
        )
    if lost := file.lost(path):
        raise InputError(f"{path} keeps no {' or '.join(lost)}: take the same format, or give faces")
    write_file(path, file, V)

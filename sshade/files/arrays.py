"""Read and write mesh files as arrays, as libigl, gpytoolbox and trimesh use them."""

from __future__ import annotations

import os
import warnings
from typing import Any, NamedTuple

import numpy as np

from sshade.core.errors import InputError
from sshade.files.mesh_file import listed
from sshade.files.meshes import read_file, write_file, write_mesh
from sshade.files.objects import mesh_in


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

    Vertices are not merged, reordered or left out. Polygons are fanned into triangles.
    ``Mesh(*sshade.read(path))`` is a validated :class:`sshade.Mesh`.

    Parameters
    ----------
    path : path
        A .ply, .obj, .off, .stl, .glb or .gltf file, or with the extras ``formats`` and ``figures`` a .3mf,
        .dae, .xyz, .vtp, .vtu or .vtk file.

    Returns
    -------
    V : (n, 3) float64
        Positions, in the order and the unit of length of the file.
    F : (m, 3) int64

    Raises
    ------
    InputError
        When the file is missing, unreadable, empty, or of another format, or a library is missing.

    Warns
    -----
    UserWarning
        When the file has oddities, such as values that its header does not declare.
    """
    file = read_file(path)
    for note in file.notes:
        warnings.warn(f"{path}: {note}", stacklevel=2)
    return Arrays(np.array(file.V), np.array(file.F))


def write(
    path: str | os.PathLike[str],
    mesh: Any,
    F: np.ndarray | None = None,
    *,
    like: str | os.PathLike[str] | None = None,
) -> None:
    """Write a mesh file: ``sshade.write("posed.ply", V, F)``.

    ``sshade.write("posed.glb", V, like="body.glb")`` writes an existing file with new positions. Texture
    coordinates, colours, materials, groups, polygons and all other contents stay, and normals turn with
    the surface. The file appears whole or not at all.

    Parameters
    ----------
    path : path
        The suffix selects the format, which is one of :func:`read` except .xyz. STL, GLB and glTF hold
        positions as float32.
    mesh : (n, 3) float64, or an object
        Positions, or a mesh as :func:`sshade.deform` takes it: of this package, of trimesh or of pyvista.
    F : (m, 3) int, optional
        Faces. Needed with positions, unless `like` is given.
    like : path, optional
        Existing file with the same vertices in the same order. `path` needs a format that holds all its
        contents, which its own format always does.

    Raises
    ------
    InputError
        When faces are missing, arrays have other shapes, a position is not finite, or faces are out of
        range. When `like` has another number of vertices or other faces, or contents that the format of
        `path` cannot hold. On an unknown suffix, positions too large for the format, or a folder that does
        not exist or is not writable.
    """
    found = mesh_in(mesh)
    V, F = (mesh, F) if found is None else (found.V, found.F)
    V = np.asarray(V, dtype=np.float64)
    finite = np.isfinite(V).reshape(len(V), -1).all(axis=1)
    if not finite.all():
        raise InputError(f"vertex {int(np.argmin(finite))} has a NaN or infinite coordinate")
    if like is None:
        if F is None:
            raise InputError("there are no faces to write; pass F, or a file that has faces as like=")
        F = np.asarray(F)
        if V.ndim != 2 or V.shape[1] != 3 or F.ndim != 2 or F.shape[1] != 3:
            raise InputError(f"a mesh has vertices (n, 3) and faces (m, 3), not {V.shape} and {F.shape}")
        if len(F) and not np.issubdtype(F.dtype, np.integer):
            raise InputError(f"faces must be integers, not {F.dtype}")
        if len(F) and (F.min() < 0 or F.max() >= len(V)):
            raise InputError(f"a face refers to vertex {F.max()} or {F.min()} of {len(V)}")
        write_mesh(path, V, F)
        return
    file = read_file(like)
    if F is not None and not np.array_equal(F, file.F):
        raise InputError("the file of `like` has other faces; they must correspond, so leave F out")
    if V.shape != file.V.shape:
        raise InputError(
            f"the file of `like` has vertices {file.V.shape}, not {V.shape}; they must correspond"
        )
    if lost := listed(file.lost(path)):
        raise InputError(f"{path} would lose the {lost}: use the format of `like`, or pass F instead")
    write_file(path, file, V)

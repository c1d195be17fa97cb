"""Read and write mesh files. The order of vertices and faces is kept exactly."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from sshade.core.errors import InputError
from sshade.core.whole_files import check_output, expecting, naming, replacing
from sshade.files.by_library import WRITABLE, check_mesh, read_by_library, write_by_library
from sshade.files.gltf import plain_gltf, read_gltf
from sshade.files.mesh_file import DECLARED, SUFFIXES, MeshFile, as_floats, copy_along
from sshade.files.numbers_in_text import rows_of
from sshade.files.obj import read_obj
from sshade.files.off import read_off
from sshade.files.ply import read_ply, write_ply
from sshade.files.stl import read_stl, write_stl
from sshade.mesh.mesh import Mesh

#: Suffixes of the formats in which :func:`write_mesh` stores positions as float32.
SINGLE = (".stl", ".glb", ".gltf")
#: Number of bytes at the beginning of a file that may declare its coordinate system.
HEAD = 4096
#: Suffixes of files that may hold points alone.
POINTS = (".ply", ".xyz")
_READERS = dict(zip(SUFFIXES, (read_ply, read_obj, read_off, read_stl, read_gltf, read_gltf), strict=True))


def read_mesh(path: str | os.PathLike[str]) -> Mesh:
    """Read a triangle mesh.

    Parameters
    ----------
    path : path
        A .ply, .obj, .off, .stl, .glb or .gltf file. Polygons with more corners are fanned into
        triangles. Vertices are not merged.

    Raises
    ------
    InputError
        When the file is missing, unreadable, empty, of another format, or holds no valid
        :class:`Mesh`.
    """
    file = read_file(path)
    with naming(path):
        return Mesh(file.V, file.F)


def read_arrays(path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return copies of the vertices and faces of a mesh file, without validation."""
    file = read_file(path)
    return np.array(file.V), np.array(file.F)


def read_file(path: str | os.PathLike[str]) -> MeshFile:
    """Read all contents of a mesh file, without validation. :func:`write_file` writes them again.

    Raises
    ------
    InputError
        When the file is missing, unreadable, empty, or of another format.
    """
    path = Path(path)
    check_mesh(path)
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the file is empty")
    suffix = path.suffix.lower()
    with expecting(f"a readable {suffix[1:].upper()} file", path):
        file = _READERS.get(suffix, read_by_library)(path)
    with path.open("rb") as opened:
        declared = DECLARED.search(opened.read(HEAD))
    if declared and not file.space:
        file = replace(file, space=declared[1].decode())
    if suffix not in POINTS and not (len(file.V) and len(file.F)):
        raise InputError(f"{path}: the file holds no triangles; give a mesh with faces")
    return file


def write_file(path: str | os.PathLike[str], file: MeshFile, V: np.ndarray) -> None:
    """Write a mesh file with all its contents and new positions.

    A file of another format receives the mesh alone; :meth:`MeshFile.lost` lists the contents that it
    lacks. The file appears whole or not at all. In another folder, files that it refers to, such as materials
    and textures, are copied beside it; where this would replace another file, it refers to the old place.

    Parameters
    ----------
    path : path
        The suffix selects the format.
    file : MeshFile
    V : (n, 3) float64
        New positions, in the order of ``file.V``.

    Raises
    ------
    InputError
        On an unknown suffix, positions too large for the format, or a folder that does not exist or is not
        writable.
    """
    path = Path(path)
    check_output(path, WRITABLE)
    if path.suffix.lower() not in file.suffixes:
        write_mesh(path, V, file.F)
        return
    content = file.content(V, path)
    copy_along(file.named, file.source, path)
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def write_mesh(path: str | os.PathLike[str], V: np.ndarray, F: np.ndarray) -> None:
    """Write a triangle mesh. The file appears whole or not at all.

    Parameters
    ----------
    path : path
        The suffix selects the format: .ply (binary, positions as float64), .obj, .off, .stl, .glb or
        .gltf. The last three hold positions as float32.
    V : (n, 3) float64
    F : (m, 3) int

    Raises
    ------
    InputError
        On an unknown suffix, positions too large for the format, or a folder that does not exist or is not
        writable.
    """
    path = Path(path)
    check_output(path, WRITABLE)
    V, F, suffix = np.asarray(V, dtype=np.float64), np.asarray(F, dtype=np.int64), path.suffix.lower()
    with replacing(path) as temporary:
        if suffix not in SUFFIXES:
            write_by_library(temporary, V, F)
        elif suffix == ".ply":
            write_ply(temporary, V, F)
        elif suffix in (".glb", ".gltf"):
            temporary.write_bytes(plain_gltf(path, V, F))
        elif suffix == ".stl":
            as_floats(V, path)  # raises InputError
            write_stl(temporary, V, F)
        elif suffix == ".obj":
            temporary.write_bytes(rows_of("v ", V) + rows_of("f ", F + 1))
        else:
            head = f"OFF\n{len(V)} {len(F)} 0\n".encode()
            temporary.write_bytes(head + rows_of("", V) + rows_of("3 ", F))

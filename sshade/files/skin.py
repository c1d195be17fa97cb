"""Materials and textures of the mesh as the page draws them."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from sshade.core.errors import InputError
from sshade.files.gltf_materials import gltf_skin
from sshade.files.materials import Material, Skin
from sshade.files.mesh_file import MORPHS, MeshFile
from sshade.files.obj_materials import obj_skin
from sshade.mesh.mesh import repeats_vertex
from sshade.mesh.surface import Surface


class DrawnSkin(NamedTuple):
    """Vertices and triangles with texture coordinates. A seam has copies of a vertex for its two sides.

    Attributes
    ----------
    vertex : (k,) int64
        Vertex of the mesh.
    uv : (k, 2) float64
        Texture coordinates; the second grows downwards.
    faces : (m, 3) int64
        Triangles, by material.
    runs : list of (int, int, int)
        First triangle, number of triangles, and place in `materials`.
    materials : list of sshade.files.materials.Material
    """

    vertex: np.ndarray
    uv: np.ndarray
    faces: np.ndarray
    runs: list[tuple[int, int, int]]
    materials: list[Material]


def has_skin(file: MeshFile) -> bool:
    """Whether an OBJ or glTF file has materials."""
    return "materials" in file.holds and file.source.suffix.lower() in (".obj", *MORPHS)


def skin_of(path: Path) -> Skin:
    """Return the materials of the triangles of a file."""
    return obj_skin(path) if path.suffix.lower() == ".obj" else gltf_skin(path)


def skin_on(file: MeshFile, surface: Surface) -> DrawnSkin:
    """Return the materials of a file for the surface in it, ready to be drawn.

    Raises
    ------
    InputError
        When materials or texture coordinates cannot be read.
    """
    try:
        return drawn(skin_of(file.source), surface.vertex[file.F])
    except (ValueError, LookupError, TypeError) as error:
        raise InputError(f"{file.source.name}: its materials cannot be read ({error})") from error


def drawn(skin: Skin, F: np.ndarray) -> DrawnSkin:
    """Prepare the materials of a file for drawing.

    Parameters
    ----------
    skin : sshade.files.materials.Skin
    F : (m, 3) int64
        Vertices of the mesh at the corners of the file's triangles; -1 where the mesh has none.
    """
    keep = np.flatnonzero((F >= 0).all(axis=1) & ~repeats_vertex(F))
    keep = keep[np.argsort(skin.material[keep], kind="stable")]
    key, faces = np.unique(F[keep] * len(skin.uv) + skin.corners[keep], return_inverse=True)
    material, first, count = np.unique(skin.material[keep], return_index=True, return_counts=True)
    runs = list(zip(first.tolist(), count.tolist(), range(len(material)), strict=True))
    materials = [skin.materials[i] for i in material.tolist()]
    vertex, row = np.divmod(key, len(skin.uv))
    return DrawnSkin(vertex, skin.uv[row], faces.reshape(-1, 3), runs, materials)

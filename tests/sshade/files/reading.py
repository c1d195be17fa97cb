"""Read mesh files with trimesh, without code of the package."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh

#: Properties of PLY that a deformation changes.
MOVED = ("x", "y", "z", "nx", "ny", "nz")


class Content(NamedTuple):
    """What a reader finds in a file.

    Attributes
    ----------
    V : (n, 3) float64
        Positions, where the scene places them.
    N : (k, 3) float64
        Normals; empty if the reader finds none.
    rest : list
        Everything else.
    """

    V: np.ndarray
    N: np.ndarray
    rest: list[Any]


def by_trimesh(path: Path) -> Content:
    """Read vertices, faces, normals, colours, texture coordinates, materials and other attributes."""
    scene = trimesh.load_scene(path, process=False, maintain_order=True)
    V, N, rest = [np.zeros((0, 3))], [np.zeros((0, 3))], []
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        mesh = scene.geometry[name]
        V.append(trimesh.transform_points(mesh.vertices, matrix))
        rest.append(type(mesh).__name__)
        if not isinstance(mesh, trimesh.Trimesh):
            continue
        for kind in ("vertex_normals", "face_normals"):
            if kind in mesh._cache.cache:  # they come from the file
                normals = getattr(mesh, kind) @ np.linalg.inv(matrix[:3, :3])
                N.append(normals / np.linalg.norm(normals, axis=1, keepdims=True))
        rest += [mesh.faces, *_looks(mesh.visual), mesh.vertex_attributes, mesh.face_attributes]
        elements = mesh.metadata.get("_ply_raw", {})
        rest += [_columns(element["data"]) for element in elements.values() if element.get("length")]
    return Content(np.concatenate(V), np.concatenate(N), rest)


def _looks(visual: Any) -> list[Any]:
    """Return colours of vertices or faces, or texture coordinates and the material."""
    if visual.kind in ("vertex", "face"):
        return [visual.kind, getattr(visual, f"{visual.kind}_colors")]
    if visual.kind != "texture":
        return []
    image = getattr(visual.material, "image", None) or getattr(visual.material, "baseColorTexture", None)
    return [visual.uv, visual.material.name, image and image.tobytes()]


def _columns(data: Any) -> dict[str, Any]:
    """Return the properties of an element of PLY that stay."""
    names = data.keys() if isinstance(data, dict) else data.dtype.names
    return {name: np.asarray(data[name]).tolist() for name in names if name not in MOVED}

"""Meshes of other libraries: their vertices and triangles, and copies of them with other positions.

They are recognised by their attributes, so that no library is imported.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from sshade.core.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.mesh.surface import rounding_steps


class MeshObject(NamedTuple):
    """The mesh in an object.

    Attributes
    ----------
    V : (n, 3) float64
    F : (m, 3) int
    moved : callable
        ``moved(V)`` returns a copy of the object with positions V (n, 3).
    rounding : (3,) float64, optional
        Rounding steps of coordinates in single precision.
    """

    V: np.ndarray
    F: np.ndarray
    moved: Callable[[np.ndarray], Any]
    rounding: np.ndarray | None = None


def mesh_in(shape: Any) -> MeshObject | None:
    """Return the mesh in an object, None if it is no known object, such as an array.

    Parameters
    ----------
    shape : object
        A :class:`sshade.Mesh`; a ``trimesh.Trimesh`` or another object with ``vertices``, ``faces`` and
        ``copy``; a ``trimesh.Scene`` with one mesh; or a ``pyvista.PolyData`` of triangles.

    Raises
    ------
    InputError
        When a scene has another number of meshes, or a PolyData has other polygons.
    """
    if isinstance(shape, Mesh):
        return MeshObject(shape.V, shape.F, lambda V: Mesh(V, shape.F))
    if _has(shape, "geometry", "graph", "copy"):
        return _scene(shape)
    if _has(shape, "points", "regular_faces", "copy"):
        return _poly_data(shape)
    if _has(shape, "vertices", "faces", "copy"):
        return MeshObject(
            _floats(shape.vertices), np.asarray(shape.faces), lambda V: _with(shape, "vertices", V)
        )
    return None


def _scene(scene: Any) -> MeshObject:
    """Open a scene at the place where its node puts the mesh."""
    nodes = scene.graph.nodes_geometry
    if len(nodes) != 1:
        raise InputError(
            f"the scene has {len(nodes)} meshes; pass scene.to_mesh(), all in one, or one of scene.dump()"
        )
    matrix, name = scene.graph[nodes[0]]
    inside = mesh_in(scene.geometry[name])
    if inside is None:
        raise InputError(f"the geometry {name!r} of the scene is no triangle mesh")
    R, t = matrix[:3, :3], matrix[:3, 3]

    def moved(V: np.ndarray) -> Any:
        copy = scene.copy()
        copy.geometry[name].vertices = np.linalg.solve(R, (V - t).T).T
        return copy

    return MeshObject(inside.V @ R.T + t, inside.F, moved)


def _poly_data(shape: Any) -> MeshObject:
    if not shape.is_all_triangles:
        raise InputError("the PolyData has polygons other than triangles; pass its .triangulate()")

    def moved(V: np.ndarray) -> Any:
        copy = _with(shape, "points", V)
        for data in (copy.point_data, copy.cell_data):  # normals of the rest shape
            if data.active_normals_name is not None:
                del data[data.active_normals_name]
        return copy

    return MeshObject(_floats(shape.points), shape.regular_faces, moved, rounding_steps(shape.points))


def _with(shape: Any, name: str, value: np.ndarray) -> Any:
    """Return a copy of an object with another value of an attribute."""
    copy = shape.copy()
    setattr(copy, name, value)
    return copy


def _floats(points: Any) -> np.ndarray:
    return np.asarray(points, dtype=np.float64)


def _has(shape: Any, *names: str) -> bool:
    return all(hasattr(shape, name) for name in names)

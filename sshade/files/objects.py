"""Meshes of other libraries: their vertices and triangles, and copies of them with other positions.

They are recognised by their attributes, so that no library is imported.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from sshade.core.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.mesh.normals import turned, turns, vertex_turns
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
        ``copy``; a ``trimesh.Scene`` with one mesh; a ``pyvista.PolyData`` of triangles; or a grid of PyVista
        with points, whose outer surface is the mesh.

    Raises
    ------
    InputError
        When a scene has another number of meshes, a PolyData has other polygons, or a grid has no points of
        its own.
    """
    if isinstance(shape, Mesh):
        return MeshObject(shape.V, shape.F, lambda V: Mesh(V, shape.F))
    if _has(shape, "geometry", "graph", "copy"):
        return _scene(shape)
    if _has(shape, "points", "extract_surface", "copy"):
        return _data_set(shape)
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


def _data_set(shape: Any) -> MeshObject:
    """Open a data set of PyVista. Its normals turn with the surface."""
    if not hasattr(shape, "SetPoints"):
        raise InputError(
            f"a {type(shape).__name__} has no points of its own; pass its .cast_to_structured_grid()"
        )
    if hasattr(shape, "regular_faces") and not shape.is_all_triangles:
        raise InputError("the PolyData has polygons other than triangles; pass its .triangulate()")
    rest, F = _floats(shape.points), outer_triangles(shape)[0]

    def moved(V: np.ndarray) -> Any:
        copy = _with(shape, "points", V)
        if (name := copy.point_data.active_normals_name) is not None:
            N = _floats(copy.point_data[name])
            copy.point_data[name] = turned(vertex_turns(N, F, rest, V), N).astype(copy.point_data[name].dtype)
        if (name := copy.cell_data.active_normals_name) is not None and len(F) == copy.n_cells:
            N, corners = _floats(copy.cell_data[name]), np.repeat(np.arange(len(F))[:, None], 3, axis=1)
            copy.cell_data[name] = turned(turns(corners, N, F, rest, V), N).astype(copy.cell_data[name].dtype)
        return copy

    return MeshObject(rest, F, moved, rounding_steps(shape.points))


def outer_triangles(shape: Any) -> tuple[np.ndarray, bool]:
    """Return the triangles (m, 3) of the surface of a data set of PyVista, and whether they are its cells.

    Polygons and cells with a volume become triangles. The corners are ids of the points of the data set.
    """
    is_surface, outer = hasattr(shape, "regular_faces"), shape
    if not is_surface:
        outer = shape.extract_surface(nonlinear_subdivision=0, algorithm="dataset_surface")
    F = outer.triangulate().faces.reshape(-1, 4)[:, 1:].astype(np.int64)
    if not is_surface and len(F):
        F = np.asarray(outer.point_data["vtkOriginalPointIds"], dtype=np.int64)[F]
    return F, bool(outer.is_all_triangles) and outer.n_cells == shape.n_cells


def _with(shape: Any, name: str, value: np.ndarray) -> Any:
    """Return a copy of an object with another value of an attribute."""
    copy = shape.copy()
    setattr(copy, name, value)
    return copy


def _floats(points: Any) -> np.ndarray:
    return np.asarray(points, dtype=np.float64)


def _has(shape: Any, *names: str) -> bool:
    return all(hasattr(shape, name) for name in names)

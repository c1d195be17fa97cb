"""The one door: vertices and faces of any kind become a surface with handles, and its positions go back.

A shape is arrays, a mesh of this package, of trimesh or of pyvista, or a mesh file that was read. The
command, Python, the editor and Blender open shapes here, make their tasks here, and place results here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sshade.core.errors import InputError
from sshade.files.mesh_file import MeshFile
from sshade.files.objects import MeshObject, mesh_in
from sshade.mesh.mesh import Mesh
from sshade.mesh.surface import Surface, surface
from sshade.mesh.weld import NEAR
from sshade.problem.handle_checks import SAME_TARGET
from sshade.problem.handles import Handles
from sshade.problem.task import DeformationTask


@dataclass(frozen=True, eq=False)
class OpenShape:
    """A shape and the surface in it that can be deformed.

    The surface lacks vertices in no face, and copies of a vertex along a seam are one vertex of it.

    Attributes
    ----------
    V : (n, 3) float64
        Positions at rest.
    F : (m, 3) int
        Triangles.
    surface : Surface
    made : callable
        ``made(V)`` returns an object of the shape's kind with positions V (n, 3): of arrays and of a file the
        positions themselves.
    """

    V: np.ndarray
    F: np.ndarray
    surface: Surface
    made: Callable[[np.ndarray], Any]

    @property
    def mesh(self) -> Mesh:
        """The surface as a mesh."""
        return self.surface.mesh

    @property
    def extent(self) -> float:
        """The `extent` of :class:`sshade.Handles`: targets of copies of a vertex may differ as they do."""
        apart = 2 * np.sqrt(3) * self.surface.facts.tolerance  # of two copies, along all axes
        return self.mesh.diagonal * max(1.0, apart / SAME_TARGET)

    def on_surface(self, handles: Handles) -> Handles:
        """Convert handles at vertices of the shape to handles at vertices of the surface.

        Raises
        ------
        InputError
            When a handle is no vertex of a face, or copies of a vertex have contradictory targets.
        """
        return replace(handles, index=self.surface.places(handles.index), extent=self.extent)

    def on_copies(self, handles: Handles) -> Handles:
        """Convert handles at vertices of the surface to handles at all copies of these vertices."""
        vertex = self.surface.vertex
        row = np.full(self.mesh.n + 1, -1)  # the last one is for vertices of no face
        row[handles.index] = np.arange(len(handles))
        index = np.flatnonzero(row[vertex] >= 0)
        index = index[np.argsort(row[vertex[index]], kind="stable")]
        return handles.sampled(row[vertex[index]], index, self.mesh.V)

    def task(
        self,
        name: str,
        handles: Handles,
        *,
        carry_unconstrained: bool = False,
        meta: Mapping[str, Any] | None = None,
    ) -> DeformationTask:
        """Return the task for handles at vertices of the surface; see :class:`sshade.DeformationTask`."""
        carry, meta = carry_unconstrained, meta or {}
        return DeformationTask(name, self.mesh, handles, meta=meta, carry_unconstrained=carry)

    def placed(self, vertices: np.ndarray) -> np.ndarray:
        """Return all positions (n, 3) of the shape, given positions (k, 3) of the surface's vertices.

        Vertices in no face stay. The result is `vertices` itself where the surface has all vertices.
        """
        return self.surface.placed(self.V, vertices)

    def moved(self, vertices: np.ndarray) -> Any:
        """Return an object of the shape's kind, given positions (k, 3) of the surface's vertices."""
        # A copy, because a method may return the rest shape itself.
        return self.made(np.array(self.placed(vertices), dtype=np.float64))


def open_shape(
    shape: Any, F: np.ndarray | None = None, *, weld: float = NEAR, repair: bool = False
) -> OpenShape:
    """Open a shape: find the surface in it that can be deformed.

    Parameters
    ----------
    shape : (n, 3) float, object or MeshFile
        Positions, with `F`; an object as :func:`sshade.files.objects.mesh_in` takes it, or as it returns it;
        or a file that :func:`sshade.files.meshes.read_file` has read.
    F : (m, 3) int, optional
        Triangles of positions.
    weld, repair
        See :func:`sshade.mesh.surface.surface`.

    Raises
    ------
    InputError
        On another object, or when there is no surface: see :func:`sshade.mesh.surface.surface`.
    """
    rounding: np.ndarray | None = None
    made: Callable[[np.ndarray], Any] = _positions
    if F is not None:
        V = np.asarray(shape, dtype=np.float64)
    elif isinstance(shape, MeshFile):
        shape.require_triangles()
        V, F, rounding = shape.V, shape.F, shape.rounding
    else:
        found = shape if isinstance(shape, MeshObject) else mesh_in(shape)
        if found is None:
            raise InputError(f"there is no mesh in an object of type {type(shape).__name__}")
        V, F, made = found.V, found.F, found.moved
    return OpenShape(V, F, surface(V, F, weld=weld, rounding=rounding, repair=repair), made)


def _positions(V: np.ndarray) -> np.ndarray:
    return V

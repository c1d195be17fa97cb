"""The triangle mesh type: validated once, read-only, with cached geometric and topological properties."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from sshade.core.errors import InputError, counted
from sshade.core.kernels import kernel
from sshade.core.notebook_view import Shown
from sshade.mesh.faces import Connectivity, connectivity, face_areas, vertex_areas
from sshade.mesh.incidence import EdgeSides, flagged, sides_by_edge

#: Largest coordinate, and reciprocal of the smallest extent. Beyond, squared areas overflow or underflow.
LARGEST = 1e60

#: Largest number of faces; the ids of their sides have 32 bits.
MOST_FACES = (2**31 - 1) // 3


class Topology(NamedTuple):
    """Euler characteristic, components and boundary loops: a proxy has the same as its mesh."""

    euler: int
    components: int
    boundary_loops: int


@dataclass(frozen=True, eq=False, repr=False)
class Mesh(Shown):
    """A triangle mesh.

    Arrays are read-only, and copied where needed. Every vertex belongs to a triangle, and no triangle
    repeats a vertex. The mesh need not be manifold, oriented or connected; functions that need this call
    :meth:`require_manifold` or :meth:`require_one_component`.

    Parameters
    ----------
    V : (n, 3) float64
        Vertex positions, in the unit of length of the file they come from.
    F : (m, 3) int
        Corner ids of each triangle, counter-clockwise seen from outside.

    Raises
    ------
    InputError
        On a wrong shape, no faces or more than :data:`MOST_FACES`, ids out of range, faces that repeat a
        vertex, vertices in no face, NaN or infinite positions, and a mesh that is too large or too small for
        float64.
    """

    V: np.ndarray
    F: np.ndarray

    def __repr__(self) -> str:
        return f"<Mesh: {self.n} vertices, {self.m} faces>"

    def __post_init__(self) -> None:
        V, F = np.ascontiguousarray(self.V, dtype=np.float64), np.asarray(self.F)
        if V.ndim != 2 or V.shape[1] != 3:
            raise InputError(f"vertices must be an (n, 3) array, not one of shape {V.shape}")
        if F.ndim != 2 or F.shape[1] != 3:
            raise InputError(f"faces must be an (m, 3) array of triangles, not one of shape {F.shape}")
        if not np.issubdtype(F.dtype, np.integer):
            raise InputError(f"faces must be integers, not {F.dtype}")
        if len(F) > MOST_FACES:
            raise InputError(f"{len(F):,} faces, and at most {MOST_FACES:,} are supported; split the mesh")
        F = np.ascontiguousarray(F, dtype=np.int64)
        if len(V) == 0 or len(F) == 0:
            raise InputError(f"a mesh needs at least one triangle, not {len(V)} vertices and {len(F)} faces")
        _check_numbers(V)
        used = np.zeros(len(V), dtype=bool)
        outside, repeated, repeating = check_faces(F, used)
        if outside >= 0:
            ids = F[outside].tolist()
            raise InputError(f"face {outside} has vertices {ids}, but the ids go from 0 to {len(V) - 1}")
        if repeated >= 0:
            raise InputError(
                f"{counted(repeating, 'face repeats', 'faces repeat')} a vertex (the first is face "
                f"{repeated}: {F[repeated].tolist()}); remove such faces; sshade.deform leaves them out"
            )
        if not used.all():
            raise InputError(
                f"{counted(int((~used).sum()), 'vertex belongs', 'vertices belong')} to no face (the first is"
                f" {int(np.argmin(used))}); remove such vertices; sshade.deform leaves them out"
            )
        object.__setattr__(self, "V", _read_only(V, self.V))
        object.__setattr__(self, "F", _read_only(F, self.F))

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make the arrays of a copy, or of a mesh from another process, read-only again."""
        self.__dict__.update(state)
        for array in (self.V, self.F):
            array.setflags(write=False)

    @property
    def n(self) -> int:
        """Number of vertices."""
        return len(self.V)

    @property
    def m(self) -> int:
        """Number of faces."""
        return len(self.F)

    @cached_property
    def diagonal(self) -> float:
        """Length of the bounding-box diagonal, the scale of every relative tolerance."""
        low, high = bounds(self.V)
        return float(np.linalg.norm(high - low))

    @cached_property
    def origin(self) -> np.ndarray:
        """(3,) float64: a point near the mesh from which to compute; zero if the mesh lies near zero.

        A coordinate at a distance of 10^9 extents from zero has seven digits of its place on the mesh.
        Sums and products of coordinates would lose the seven digits. Coordinates relative to this point are
        exact.
        """
        low, high = bounds(self.V)
        extent = float((high - low).max())
        if extent == 0.0:
            return np.zeros(3)
        grid = 2.0 ** (np.ceil(np.log2(extent)) + 2)  # a power of two, so that subtracting is exact
        return np.round(0.5 * (low + high) / grid) * grid

    @cached_property
    def face_normals(self) -> np.ndarray:
        """(m, 3) unit normals; zero on zero-area faces."""
        a, b, c = (self.V[self.F[:, i]] for i in range(3))
        return unit_rows(np.cross(b - a, c - a))

    @cached_property
    def _areas(self) -> tuple[np.ndarray, np.ndarray]:
        return face_areas(self.V, self.F)

    @property
    def face_areas(self) -> np.ndarray:
        """(m,) triangle areas."""
        return self._areas[0]

    @cached_property
    def vertex_areas(self) -> np.ndarray:
        """(n,) a third of the summed areas of the triangles around each vertex."""
        return vertex_areas(self.F, self.face_areas, self.n)

    @property
    def without_area(self) -> np.ndarray:
        """(m,) bool: needles and collapsed faces; see :data:`sshade.mesh.faces.NO_AREA`."""
        return self._areas[1]

    @property
    def area(self) -> float:
        """Total surface area."""
        return float(self.face_areas.sum())

    @cached_property
    def volume(self) -> float:
        """Enclosed volume of a closed, oriented mesh; negative if faces point inwards."""
        # Relative to the centre of the bounding box. Far from the origin the sum would cancel.
        centre = 0.5 * (self.V.min(axis=0) + self.V.max(axis=0))
        a, b, c = (self.V[self.F[:, i]] - centre for i in range(3))
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

    @property
    def _sides(self) -> EdgeSides:
        return sides_by_edge(self.F, self.n)

    @cached_property
    def edges(self) -> np.ndarray:
        """(e, 2) int64 undirected edges, the smaller id first, in lexicographic order."""
        return self._sides.ends.astype(np.int64)

    @property
    def mean_edge(self) -> float:
        """Mean edge length."""
        ends = self.V[self.edges]
        return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean())

    @cached_property
    def boundary_edges(self) -> np.ndarray:
        """(b, 2) int64 edges with exactly one face."""
        sides = self._sides
        return sides.ends[sides.faces == 1].astype(np.int64)

    @property
    def is_closed(self) -> bool:
        """Every edge has two faces or more."""
        return self.connectivity.boundary_edges == 0

    @cached_property
    def connectivity(self) -> Connectivity:
        """Neighbours, components, and checks of the faces; see the class."""
        return connectivity(self.F, self.n)

    @property
    def component(self) -> np.ndarray:
        """(n,) int32 connected component of each vertex."""
        return self.connectivity.component

    def part(self, vertices: np.ndarray, faces: np.ndarray) -> Mesh:
        """Return a mesh of some faces (ids or a mask); `vertices` (k,) are all their vertices, ascending."""
        return Mesh(self.V[vertices], np.searchsorted(vertices, self.F[faces]))

    def components_without(self, index: np.ndarray) -> np.ndarray:
        """Return the components (u,) without any of the vertices `index` (k,)."""
        return np.setdiff1d(np.arange(self.topology.components), self.component[index])

    @property
    def is_manifold(self) -> bool:
        """Each edge has at most two faces, and the faces of each vertex form one fan."""
        return self.connectivity.crowded_edge[0] == -1 and self.connectivity.split_vertex == -1

    @property
    def is_oriented(self) -> bool:
        """No two faces run through an edge in the same direction."""
        return self.connectivity.oriented

    @property
    def topology(self) -> Topology:
        """Euler characteristic, number of components, number of boundary loops."""
        facts = self.connectivity
        return Topology(self.n - facts.edges + self.m, facts.components, facts.boundary_loops)

    def checked(self, positions: np.ndarray, name: str = "shape") -> np.ndarray:
        """Return other positions (n, 3) of the vertices as float64; error messages call them `name`.

        Raises
        ------
        InputError
            On another shape, or positions that a mesh cannot have; see :class:`Mesh`.
        """
        V = np.ascontiguousarray(positions, dtype=np.float64)
        if V.shape != self.V.shape:
            raise InputError(f"the {name} has shape {V.shape}, the mesh {self.V.shape}; they must correspond")
        _check_numbers(V, name)
        return V

    def require_handles(
        self, index: np.ndarray, *, everywhere: bool = True, advice: str = "give each one"
    ) -> None:
        """Raise InputError unless ids (k,) are vertices and, with `everywhere`, each component has one.

        The `advice` says what to do about components without a handle.
        """
        outside = index[(index < 0) | (index >= self.n)]
        if len(outside):
            raise InputError(f"handle id {outside[0]} is out of range: the mesh has {self.n} vertices")
        free = np.flatnonzero(~flagged(self.component[index], self.connectivity.components))
        if everywhere and len(free):
            sizes, first = np.bincount(self.component), np.argmax(self.component == free[0])
            raise InputError(
                f"{len(free)} of the mesh's {counted(len(sizes), 'component', 'components')} "
                f"{'has' if len(free) == 1 else 'have'} no handle (the first has "
                f"{sizes[free[0]]} vertices, such as vertex {first}); {advice}"
            )

    def require_manifold(self) -> None:
        """Raise InputError unless the mesh is manifold and consistently oriented."""
        facts = self.connectivity
        if facts.crowded_edge[0] != -1:
            i, j, faces = facts.crowded_edge
            raise InputError(
                f"the mesh is not manifold: edge ({i}, {j}) has {faces} faces, and at most two are supported"
                "; split the mesh there, or drop faces that are there twice"
            )
        if facts.split_vertex != -1:
            raise InputError(
                f"the mesh is not manifold: the faces at vertex {facts.split_vertex} form more than one fan; "
                "duplicate the vertex, one copy per fan"
            )
        if not self.is_oriented:
            raise InputError(
                "the faces are not consistently oriented (two neighbours run through their edge in the "
                "same direction); flip them to agree, e.g. with trimesh.repair.fix_winding; a one-sided "
                "surface has no such orientation: sshade.deform and sshade.transfer_pose cut it"
            )

    def require_one_component(self) -> None:
        """Raise InputError unless the mesh is connected."""
        count = self.topology.components
        if count > 1:
            sizes = np.sort(np.bincount(self.component))[::-1]
            raise InputError(
                f"the mesh has {count} components (the largest have {sizes[:3].tolist()} vertices); "
                "only one is supported: deform them one by one, or weld coincident vertices"
            )


def require_mesh(mesh: object, subject: str) -> None:
    """Raise TypeError unless the argument of `subject` is a :class:`Mesh`."""
    if not isinstance(mesh, Mesh):
        raise TypeError(
            f"{subject} takes a sshade.Mesh, not a {type(mesh).__name__}; make one by sshade.Mesh(V, F)"
        )


def _check_numbers(V: np.ndarray, name: str = "mesh") -> None:
    """Raise InputError on positions that are not finite or exceed the range of float64."""
    low, high = bounds(V)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        bad = int(np.flatnonzero(~np.isfinite(V).all(axis=1))[0])
        raise InputError(f"vertex {bad} has a NaN or infinite coordinate in the {name}")
    farthest, extent = float(np.maximum(-low, high).max()), float((0.5 * high - 0.5 * low).max())
    if farthest > LARGEST or 0 < extent < 1 / LARGEST:
        raise InputError(
            f"the {name} has coordinates up to {farthest:.1e} and an extent of {2 * extent:.1e}, with which "
            f"areas cannot be squared; scale it to between {1 / LARGEST:.0e} and {LARGEST:.0e}"
        )


def _read_only(array: np.ndarray, original: object) -> np.ndarray:
    """Return an array that nobody can write to; a copy if the caller still could."""
    base: Any = array
    while isinstance(base, np.ndarray) and not base.flags.writeable:
        base = base.base
    if not isinstance(base, np.ndarray):
        return array
    if not array.flags.writeable or array is original or np.may_share_memory(array, np.asarray(original)):
        array = array.copy()
    array.setflags(write=False)
    return array


def repeats_vertex(F: np.ndarray) -> np.ndarray:
    """Return (m,) bool: faces (m, 3) that have a vertex twice."""
    return (F[:, 0] == F[:, 1]) | (F[:, 1] == F[:, 2]) | (F[:, 2] == F[:, 0])


def unit_rows(vectors: np.ndarray) -> np.ndarray:
    """Return vectors (k, 3) with length 1; a zero vector stays zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def bounds(V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the greatest coordinates (3,) of positions (n, 3); NaN where one is NaN."""
    # Reducing an array of three columns along its first axis takes NumPy twenty times as long.
    columns = [V[:, c] for c in range(3)]
    return np.array([x.min() for x in columns]), np.array([x.max() for x in columns])


@kernel
def check_faces(F, used):
    """Check faces (m, 3) int64 and mark the vertices that they use in `used` (n,) bool.

    Returns the first face with an id out of range, at which the check stops; the first face that repeats a
    vertex; and the number of faces that repeat a vertex. A face is -1 if there is none.
    """
    first, repeating = -1, 0
    for f in range(len(F)):
        i, j, k = F[f, 0], F[f, 1], F[f, 2]
        if min(i, j, k) < 0 or max(i, j, k) >= len(used):
            return f, -1, 0
        if i == j or j == k or k == i:
            first = f if repeating == 0 else first
            repeating += 1
        used[i] = used[j] = used[k] = True
    return -1, first, repeating

"""Make a mesh that can be deformed from the vertices and faces of a file or another program."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sshade.core.errors import InputError
from sshade.mesh.cutting import without_duplicates
from sshade.mesh.mesh import Mesh, check_faces, repeats_vertex
from sshade.mesh.places import first_at_label, pinches, vertex_places, with_faces
from sshade.mesh.seams import seams
from sshade.mesh.weld import NEAR, check_weld

#: Largest distance of a copy of a vertex from its place, in rounding steps of the largest coordinate, where
#: positions are stored as float32.
STEPS = 2


@dataclass(frozen=True)
class SurfaceFacts:
    """What had to be done to get a surface.

    Attributes
    ----------
    unused : int
        Vertices that no face uses.
    near : int
        Vertices merged with another near their place, but not exactly there.
    collapsed, duplicates : int
        Faces that repeat a vertex; of a repair, faces there twice.
    tolerance : float
        Largest distance of a copy of a vertex from its place, as a fraction of the diagonal.
    """

    unused: int = 0
    near: int = 0
    collapsed: int = 0
    duplicates: int = 0
    tolerance: float = 0.0


class Surface(NamedTuple):
    """A mesh, and how it relates to the vertices and faces that it was made from.

    Attributes
    ----------
    mesh : Mesh
    vertex : (n,) int64
        Vertex of `mesh` for each original vertex; -1 where it has none.
    facts : SurfaceFacts
    """

    mesh: Mesh
    vertex: np.ndarray
    facts: SurfaceFacts

    def placed(self, V: np.ndarray, moved: np.ndarray) -> np.ndarray:
        """Return the original vertices V (n, 3), with the vertices of the mesh placed at `moved` (k, 3).

        The result is `moved` itself where the mesh has all original vertices.
        """
        if len(moved) == len(V):  # then each vertex of the mesh is the original vertex of its number
            return moved
        return np.where((self.vertex >= 0)[:, None], moved[self.vertex], V)

    def picked(self, V: np.ndarray) -> np.ndarray:
        """Return the positions (k, 3) of the mesh's vertices, given V (n, 3) of the original ones."""
        return V if len(V) == self.mesh.n else V[self.original]

    def places(self, index: np.ndarray) -> np.ndarray:
        """Return the vertices (k,) of the mesh for original vertices (k,) that are handles.

        Raises
        ------
        InputError
            When a handle is out of range, or belongs to no face.
        """
        outside = index[index >= len(self.vertex)]
        if len(outside):
            raise InputError(
                f"handle id {outside[0]} is out of range: the mesh has {len(self.vertex)} vertices"
            )
        places = self.vertex[index]
        if (places < 0).any():
            raise InputError(f"handle vertex {index[np.argmin(places)]} belongs to no face")
        return places

    @property
    def original(self) -> np.ndarray:
        """(k,) int64: the first of the original vertices of each vertex of the mesh."""
        used, first = np.flatnonzero(self.vertex >= 0), np.empty(self.mesh.n, dtype=np.int64)
        first[self.vertex[used[::-1]]] = used[::-1]  # of several numbers, the last one stays
        return first

    def merged(self, first: np.ndarray) -> Surface:
        """Merge each vertex of the mesh with the vertex `first` (k,) of its group; facts stay."""
        if (first == np.arange(len(first))).all():
            return self
        mesh, vertex, _ = cleaned(self.mesh.V, first[self.mesh.F])
        return Surface(mesh, np.where(self.vertex >= 0, vertex[first[self.vertex]], -1), self.facts)


def surface(
    V: np.ndarray,
    F: np.ndarray,
    *,
    weld: float | None = None,
    rounding: np.ndarray | None = None,
    repair: bool = False,
) -> Surface:
    """Leave out whatever is not part of a surface, and join seams.

    Drops faces that repeat a vertex, then vertices that no face uses (:func:`cleaned`), and merges
    vertices along seams (:func:`sshade.mesh.seams.seams`) and where fans meet in a point
    (:func:`sshade.mesh.places.pinches`): fans of one component, or of vertices that the file has split. In a
    soup, where no two faces share a vertex, all vertices at one place are merged, as they are in a file with
    vertex ids. Everything else keeps its position and its order.

    Parameters
    ----------
    V : (n, 3) float
    F : (m, 3) int
    weld : float, optional
        Largest distance of a copy of a vertex from its place, as a fraction of the bounding-box diagonal.
        Raise it if a file has gaps along seams; 0 merges exact copies alone. The default is
        :data:`sshade.mesh.weld.NEAR`, or :data:`STEPS` rounding steps where they are larger. At any `weld`,
        copies are far nearer to each other than to their neighbours: see :data:`sshade.mesh.weld.COPY`.
    rounding : (3,) float64, optional
        Rounding steps of the coordinates. By default, those of the type of V; float64 counts as exact.
    repair : bool
        Merge all vertices at one place, along seams or not, and drop faces that are there twice.

    Raises
    ------
    InputError
        As :class:`sshade.Mesh`; also when every face repeats a vertex, all vertices coincide, or `weld` is
        out of range.
    """
    if weld is not None:
        check_weld(weld)
    whole = cleaned(V, F)
    if whole.mesh.diagonal == 0:
        raise InputError("all vertices of the mesh coincide; there is no surface to deform")
    tolerance = np.full(3, (NEAR if weld is None else weld) * whole.mesh.diagonal)
    if weld is None:
        tolerance = np.maximum(tolerance, STEPS * (rounding_steps(V) if rounding is None else rounding))
    facts = replace(whole.facts, tolerance=float(tolerance.max()) / whole.mesh.diagonal)
    result = whole._replace(facts=facts)
    if repair:
        result = _welded(result, tolerance)
    else:
        soup = whole.mesh.n == 3 * whole.mesh.m
        for within in (np.zeros(3), tolerance):
            if not result.mesh.is_closed:
                result = result.merged(_by_place(result.mesh, within) if soup else seams(result.mesh, within))
        result = _pinched(result)
    if result.mesh.n == whole.mesh.n:
        return result
    elsewhere = (result.mesh.V[result.vertex] != np.asarray(V)).any(axis=1)
    near = int(elsewhere[result.vertex >= 0].sum())
    return result._replace(facts=replace(result.facts, near=near))


def _welded(whole: Surface, tolerance: np.ndarray) -> Surface:
    """Merge all vertices at one place, and drop faces that are there twice."""
    first = first_at_label(vertex_places(whole.mesh, tolerance))
    if repeats_vertex(first[whole.mesh.F]).all():
        raise InputError(
            f"{_every(whole.mesh.m, 'has', 'have')} two corners at one place, where repair welds them; leave "
            "it out"
        )
    welded = whole.merged(first)
    once = without_duplicates(welded.mesh)
    collapsed = whole.facts.collapsed + whole.mesh.m - welded.mesh.m
    facts = replace(whole.facts, collapsed=collapsed, duplicates=welded.mesh.m - once.m)
    return welded._replace(mesh=once, facts=facts)


def _pinched(result: Surface) -> Surface:
    """Join fans that meet in a point: of one component, or where the file has copies of both fans' vertex."""
    result = result.merged(pinches(result.mesh, result.mesh.component))
    split = np.bincount(result.vertex[result.vertex >= 0]) > 1
    if not split.any():
        return result
    return result.merged(pinches(result.mesh, np.where(split, -1, np.arange(result.mesh.n))))


def _every(number: int, one: str, several: str) -> str:
    """Return the subject of a sentence on all faces, with its verb."""
    return f"the only face {one}" if number == 1 else f"all {number} faces {several}"


def _by_place(mesh: Mesh, tolerance: np.ndarray) -> np.ndarray:
    """Return (n,) int64: the first of the vertices at the place of each vertex."""
    return with_faces(mesh, first_at_label(vertex_places(mesh, tolerance)))


def rounding_steps(V: np.ndarray) -> np.ndarray:
    """Return the rounding steps (3,) float64 of the coordinates of an array; 0 unless it is float32."""
    return single_steps(np.asarray(V)) if np.asarray(V).dtype == np.float32 else np.zeros(3)


def single_steps(V: np.ndarray) -> np.ndarray:
    """Return the rounding steps (3,) float64 of the largest finite coordinates of V (n, 3) in float32."""
    largest = np.where(np.isfinite(V), np.abs(V), 0.0).max(axis=0, initial=0.0)
    return np.spacing(largest.astype(np.float32)).astype(np.float64)


def as_single(V: np.ndarray) -> np.ndarray:
    """Return V (n, 3) float64 as float32 holds it."""
    with np.errstate(over="ignore", under="ignore"):
        return V.astype(np.float32).astype(np.float64)


def cleaned(V: np.ndarray, F: np.ndarray) -> Surface:
    """Drop faces that repeat a vertex, then vertices that no face uses; seams stay.

    Parameters, result and errors are as in :func:`surface`.
    """
    V, F = np.asarray(V), np.asarray(F)
    if F.ndim != 2 or F.shape[1] != 3 or not np.issubdtype(F.dtype, np.integer):
        Mesh(V, F)  # raises InputError
    used = np.zeros(len(V), dtype=bool)
    outside, _, repeating = check_faces(np.ascontiguousarray(F, dtype=np.int64), used)
    if outside >= 0 or len(F) == 0:
        Mesh(V, F)  # raises InputError
    if repeating == len(F):
        raise InputError(f"{_every(len(F), 'repeats', 'repeat')} a vertex; there is no surface to deform")
    if repeating:
        F, used = F[~repeats_vertex(F)], np.zeros(len(V), dtype=bool)
        used[F] = True
    if (V[F[0]] == V[F[0, 0]]).all() and (V[F] == V[F[:, :1]]).all():
        raise InputError(f"{_every(len(F), 'is a point', 'are points')}; there is no surface to deform")
    vertex = np.arange(len(V))
    facts = SurfaceFacts(unused=int((~used).sum()), collapsed=int(repeating))
    if not used.all():
        vertex = np.where(used, np.cumsum(used) - 1, -1)
        V, F = V[used], vertex[F]
    return Surface(Mesh(V, F), vertex, facts)  # raises whatever else is wrong

"""The surface beside the edges of handle regions turns with its region.

It would crease where it is clamped. Handles without an inside, such as single vertices or lines, have no
rotation: their distances to the targets are spread over the surface beside them.
"""

from __future__ import annotations

from functools import cached_property, reduce
from operator import matmul

import numpy as np
from scipy.sparse import csr_array, eye_array
from scipy.sparse.csgraph import connected_components

from sshade.core.kernels import kernel
from sshade.mesh.adjacency import VertexGraph
from sshade.mesh.harmonic import harmonic
from sshade.mesh.incidence import flagged, numbered
from sshade.mesh.mesh import Mesh
from sshade.problem.handles import Handles
from sshade.proxy.blended import nearest_rotations
from sshade.proxy.fronts import Fronts
from sshade.proxy.vertex_maps import VertexMaps

#: Least fraction of a region's handles that are surrounded by handles, for the region to have a rotation.
#: Among single vertices some triples happen to be faces, whose rotation means nothing.
SURROUNDED = 0.1
#: Angles of a region against the surface beside it, in radians. Up to the first the angle is a crease and is
#: removed; from the second on it is a bend and stays, because removing it would stretch the surface.
CREASE, BEND = 0.3, 0.9
#: Number of rings of neighbours along a region's edge over which the angle is averaged.
RINGS = 4
#: Width of the surface beside an edge that turns with its region, as a multiple of the distance between
#: samples plus the distance between vertices.
WIDTH = 3.0


class RegionEdges:
    """The surface beside the edges of handle regions.

    Parameters
    ----------
    mesh : Mesh
        M.
    graph : VertexGraph
        Of M.
    vertices : int
        Number of samples.
    edge : (k,) int64
        Hard handle vertices on the edges of regions.
    fixed : (n,) bool
        Hard handle vertices.
    soft : (s,) int64
        Soft handle vertices.
    """

    def __init__(
        self,
        mesh: Mesh,
        graph: VertexGraph,
        *,
        vertices: int,
        edge: np.ndarray,
        fixed: np.ndarray,
        soft: np.ndarray,
    ) -> None:
        self._mesh, self._graph, self._vertices = mesh, graph, vertices
        self._edge, self._fixed, self._soft = edge, fixed, soft

    def prepare(self) -> None:
        """Compute what depends on the rest shape alone."""
        self._arms, self._maps, self._along  # noqa: B018 - cached

    def move_beside(self, moved: np.ndarray, V: np.ndarray, handles: Handles) -> None:
        """Move the surface beside hard handles that went to their targets.

        A vertex goes from v' to ``(1 - phi) v' + phi (t_e + R_e (v - v_e))``. v_e is the nearest edge vertex,
        t_e its target, and R_e the rotation of its region: prescribed, or fitted to the faces between
        handles. phi falls from 1 at the edge, with slope 0, to 0, and is smaller where the surface bends
        beside the region. Beside handles without a rotation, v' moves by the harmonic function that is
        ``t_e - v_e'`` at the handles and 0 where phi ends. Soft handles there follow.

        Parameters
        ----------
        moved : (n, 3) float64
            V with hard handles at their targets; is changed.
        V : (n, 3) float64
            M', prolonged from the proxy.
        handles : Handles
            At their targets, with their rotations.
        """
        (vertex, nearest, phi), edge = self.margin, self._edge
        R, prescribed = self._rotations(moved, handles)
        rotated, (arm, arms) = np.isfinite(R[:, 0, 0]), self._arms
        offset, offsets = np.zeros_like(arm), np.zeros(len(edge))
        _add_offsets(vertex, nearest, arm, edge, R, moved, V, offset, offsets)
        weight = self._crease_weights(offsets, np.where(rotated, arms, 0.0))
        weight[prescribed] = 1.0
        moved[vertex] += (phi * weight[nearest])[:, None] * offset
        movable, free = vertex[~rotated[nearest]], edge[~rotated]
        missed = moved[free] - V[free]
        if len(movable) and missed.any():
            known = np.zeros_like(V)
            known[free] = missed
            moved[movable] += harmonic(self._graph, movable, known)

    @cached_property
    def margin(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Movable vertices beside the edges, the number of the nearest edge vertex for each, and phi.

        phi is 0 half-way between two regions, where the nearest edge changes, and at soft handles, which the
        solver has placed.
        """
        graph = self._graph
        if len(self._edge) == 0:
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0)
        fronts = Fronts(graph, self._edge)
        distance, nearest = fronts.distance, self._edge[fronts.cell]
        width = WIDTH * np.sqrt(self._mesh.area) * (self._vertices**-0.5 + graph.n**-0.5)
        vertex = np.flatnonzero((distance < width) & ~self._fixed)
        phi = _smooth_fall(distance[vertex] / width)
        nearest_region = self._region[nearest]
        owner = np.repeat(np.arange(graph.n), np.diff(graph.indptr))
        between = np.unique(owner[nearest_region[owner] != nearest_region[graph.indices]])
        between = np.union1d(between, self._soft)
        if len(between):
            near, other = distance[vertex], Fronts(graph, between).distance[vertex]
            other = np.minimum(other, np.finfo(float).max)  # infinite on a component without a between
            phi = phi * (1 - _smooth_fall(other / np.maximum(near, other)))
        return vertex, fronts.cell[vertex], phi

    def _rotations(self, moved: np.ndarray, handles: Handles) -> tuple[np.ndarray, np.ndarray]:
        """Return the rotations of the regions at the k vertices of their edges.

        Returns
        -------
        (k, 3, 3) float64
            NaN where none is known.
        (k,) bool
            Where a rotation is prescribed.
        """
        R, prescribed = np.full((len(self._edge), 3, 3), np.nan), np.zeros(len(self._edge), dtype=bool)
        if self._maps:
            vertex, of_edge, maps = self._maps
            A = maps(moved[vertex])[0]
            R[of_edge >= 0] = nearest_rotations(A[of_edge[of_edge >= 0]])
        if handles.prescribed_rotations:
            rotated, rotations = handles.prescribed_rotations
            number = numbered(rotated, self._mesh.n)[self._edge]
            prescribed = number >= 0
            R[prescribed] = rotations[number[prescribed]]
        return R, prescribed

    def _crease_weights(self, offsets: np.ndarray, arms: np.ndarray) -> np.ndarray:
        """(k,) weights at edge vertices: from 1 up to an angle of :data:`CREASE` to 0 from :data:`BEND` on.

        `offsets` and `arms` (k,) have sums of lengths over the vertices nearest to each edge vertex. The
        angle is the ratio of their sums over an edge vertex and its neighbours along the edge.
        """
        offsets, arms = (self._along @ np.column_stack([offsets, arms])).T
        angle = offsets / np.where(arms > 0, arms, 1.0)
        return _smooth_fall(np.maximum(angle - CREASE, 0.0) / (BEND - CREASE))

    @cached_property
    def _along(self) -> csr_array:
        """(k, k) numbers of walks of :data:`RINGS` steps between edge vertices; a step may stay in place."""
        along = self._graph.matrix[self._edge][:, self._edge]
        along.data[:] = 1.0
        step = along + eye_array(len(self._edge), format="csr")
        return reduce(matmul, [step] * RINGS)

    @cached_property
    def _arms(self) -> tuple[np.ndarray, np.ndarray]:
        """(b, 3) margin vertices at rest minus their edge vertices, and (k,) sums of the lengths."""
        vertex, nearest, _ = self.margin
        arm = self._mesh.V[vertex] - self._mesh.V[self._edge[nearest]]
        return arm, np.bincount(nearest, np.linalg.norm(arm, axis=1), len(self._edge))

    @cached_property
    def _region(self) -> np.ndarray:
        """(n,) int32: number of the connected region of each hard handle vertex; 0 elsewhere."""
        handles = np.flatnonzero(self._fixed)
        region = np.zeros(self._mesh.n, dtype=np.int32)
        region[handles] = connected_components(self._graph.matrix[handles][:, handles], directed=False)[1]
        return region

    @cached_property
    def _maps(self) -> tuple[np.ndarray, np.ndarray, VertexMaps] | None:
        """Vertices of faces between handles at the edges of regions, and the affine maps around them.

        Between them stands the number of the vertex, -1 if none, for each of the k vertices of edges. None if
        no region has enough surrounded handles for a rotation.
        """
        at_edge, region = flagged(self._edge, self._mesh.n), self._region
        hard, count = np.flatnonzero(self._fixed), region.max() + 1
        size, edge = (np.bincount(region[i], minlength=count) for i in (hard, self._edge))
        F = self._mesh.F[at_edge[self._mesh.F].any(axis=1)]
        F = F[self._fixed[F].all(axis=1)]
        F = F[(size - edge >= SURROUNDED * size)[region[F[:, 0]]]]
        if len(F) == 0:
            return None
        vertex, F = np.unique(F, return_inverse=True)
        number = numbered(vertex, self._mesh.n)[self._edge]
        return vertex, number, VertexMaps.at_rest(Mesh(self._mesh.V[vertex], F.reshape(-1, 3)))


def _smooth_fall(x: np.ndarray) -> np.ndarray:
    """Fall from 1 at 0 to 0 from 1 on, with slope 0 at both ends."""
    x = np.minimum(x, 1.0)
    return 1 - x * x * (3 - 2 * x)


@kernel
def _add_offsets(vertex, nearest, arm, edge, R, moved, V, offset, offsets):
    """Write the offsets (b, 3) of margin vertices, and add their lengths to the sums (k,) of edge vertices.

    Where the rotation is NaN, both stay.
    """
    for i in range(len(vertex)):
        v, e = vertex[i], nearest[i]
        if np.isnan(R[e, 0, 0]):
            continue
        square = 0.0
        for r in range(3):
            turned = R[e, r, 0] * arm[i, 0] + R[e, r, 1] * arm[i, 1] + R[e, r, 2] * arm[i, 2]
            x = turned + moved[edge[e], r] - V[v, r]
            offset[i, r] = x
            square += x * x
        offsets[e] += np.sqrt(square)

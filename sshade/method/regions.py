"""Handles that are regions: few samples inside, the surface turned with their edges, the volume corrected.

A handle vertex whose neighbours are all handles tells the surface outside nothing. Where most handles are of
this kind, the sampling counts a third of each distance between handle vertices. The inside of a region then
keeps one sample for every nine outside. The samples inside determine the motion, rotation and volume of the
region. Samples that are handle vertices are the proxy's handles; up to a quarter of all samples lie on edges.

In the end every hard handle vertex goes to its target. The surface beside an edge turns with its region,
because it would crease where it is clamped. Handles without an inside, such as single vertices or lines, have
no rotation: their distances to the targets are spread over the surface beside them.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, reduce
from operator import matmul

import numpy as np
from scipy.sparse import csr_array, eye_array
from scipy.sparse.csgraph import connected_components

from sshade.core.kernels import kernel
from sshade.core.threads import in_ranges
from sshade.mesh.adjacency import VertexGraph
from sshade.mesh.harmonic import harmonic
from sshade.mesh.mesh import Mesh
from sshade.mesh.sides import flagged, numbered
from sshade.method.normal_shift import shifted
from sshade.problem.facts import Facts
from sshade.problem.handles import Handles
from sshade.problem.options import Options
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.proxy.blended import nearest_rotations
from sshade.proxy.fronts import Fronts, thinned
from sshade.proxy.sample import proxy_vertices
from sshade.proxy.vertex_maps import VertexMaps
from sshade.solver.constraints import ROUNDING, volume_and_area

#: Length of an edge between handle vertices in the sampling, as a fraction of its length.
INSIDE = 1 / 3
#: At most a quarter of the samples, or 100 if more, lie on region edges.
EDGE_RATIO, EDGE_SAMPLES = 4, 100
#: Largest move of a vertex by the volume correction, in distances between samples.
SHIFT = 0.1
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


class HandleRegions:
    """The handle vertices of a mesh, as its proxies use them.

    Parameters
    ----------
    mesh : Mesh
        M.
    handles : Handles
        Of a task.
    vertices : int
        Number of samples.
    graph : VertexGraph
        Of M.
    volume_goal : float, optional
        Volume that M' is to have, as a multiple of the volume of M. The volume is then corrected without
        regions, too.

    Attributes
    ----------
    vertices, graph, volume_goal
        The parameters.
    regional : bool
        Whether more than half of the handles are surrounded by others, or handles are more than half of the
        samples. Otherwise every handle is a sample, and no method here changes anything.
    covered : bool
        Whether every vertex is a hard handle.
    number : (n,) int64
        Handle of each vertex, or -1.
    fixed : (n,) bool
        Vertices that are hard handles.
    first : (f,) int64
        Vertices to sample first.
    metric : VertexGraph
        Graph that measures distances for sampling the remaining vertices.
    """

    def __init__(
        self,
        mesh: Mesh,
        handles: Handles,
        *,
        vertices: int,
        graph: VertexGraph,
        volume_goal: float | None = None,
    ) -> None:
        self.volume_goal = volume_goal
        self._mesh, self._handles, self.vertices, self.graph = mesh, handles, vertices, graph
        index, self._hard = handles.index, handles.hard
        self.number = numbered(index, mesh.n)
        handle = self.number >= 0
        # Hard handle vertices: `_hard_index` has all ids, `fixed` (n,) marks them, and `_edge` has the ids
        # on the edges of regions.
        self._hard_index = index[self._hard]
        self.fixed = flagged(self._hard_index, mesh.n)
        self.covered = bool(handles.hard.sum() == mesh.n)
        edge = edge_vertices(mesh, index)
        self.regional = _are_regions(len(edge), len(index), vertices)
        self.metric, self.first = graph, index
        self._edge = edge if self._hard.all() else edge_vertices(mesh, self._hard_index)
        if self.regional and not self.covered:
            owner = np.repeat(np.arange(mesh.n), np.diff(graph.indptr))
            inside = handle[owner] & handle[graph.indices]
            self.metric = replace(graph, lengths=np.where(inside, INSIDE, 1.0) * graph.lengths)
            # A hard handle between soft handles may lie on no edge of all handles. It moves the soft handles,
            # and is therefore sampled.
            edge = np.concatenate([edge, np.setdiff1d(self._edge, edge)])
            edge = thinned(graph, edge, max(vertices // EDGE_RATIO, EDGE_SAMPLES))
            self.first = np.concatenate([edge, self._one_of_each(edge)])

    def _one_of_each(self, sampled: np.ndarray) -> np.ndarray:
        """A vertex of each group of soft handles, and of rotations, that has no sample yet."""
        handles, there, found = self._handles, self.number[sampled], []
        for kind in (~handles.hard, handles.has_rotation):
            groups, first = np.unique(handles.group[kind], return_index=True)
            missing = ~np.isin(groups, handles.group[there[kind[there]]])
            found.append(handles.index[kind][first[missing]])
        return np.union1d(*found)

    def on_targets(self, V: np.ndarray, handles: Handles) -> np.ndarray:
        """Move every hard handle vertex to its target, and turn the surface beside regions with them.

        Parameters
        ----------
        V : (n, 3) float64
            M', prolonged from the proxy.
        handles : Handles
            At their targets, with their rotations.

        Returns
        -------
        (n, 3) float64
            ``(1 - phi) v' + phi (t_e + R_e (v - v_e))``. v_e is the nearest edge vertex, t_e its target, and
            R_e the rotation of its region: prescribed, or fitted to the faces between handles. phi falls
            from 1 at the edge, with slope 0, to 0, and is smaller where the surface bends beside the region.
            Beside handles without a rotation, v' moves by the harmonic function that is ``t_e - v_e'`` at the
            handles and 0 where phi ends. Soft handles there follow.
        """
        if not self.regional or len(self._hard_index) == 0:
            return V
        moved = V.copy()
        moved[self._hard_index] = handles.target[self._hard]
        (vertex, nearest, phi), edge = self._margin, self._edge
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
            moved[movable] += harmonic(self.graph, movable, known)
        return moved

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
        along = self.graph.matrix[self._edge][:, self._edge]
        along.data[:] = 1.0
        step = along + eye_array(len(self._edge), format="csr")
        return reduce(matmul, [step] * RINGS)

    @cached_property
    def _arms(self) -> tuple[np.ndarray, np.ndarray]:
        """(b, 3) margin vertices at rest minus their edge vertices, and (k,) sums of the lengths."""
        vertex, nearest, _ = self._margin
        arm = self._mesh.V[vertex] - self._mesh.V[self._edge[nearest]]
        return arm, np.bincount(nearest, np.linalg.norm(arm, axis=1), len(self._edge))

    def prepare(self) -> None:
        """Compute the rest-shape data of :meth:`on_targets`, in a thread that has time."""
        if self.regional and len(self._hard_index):
            self._arms, self._maps, self._along  # noqa: B018 - cached

    @property
    def volume(self) -> float:
        """Volume that M' is to have, in length^3.

        It is 0 without regions and without a goal, or where M encloses no volume.
        """
        corrects = self.regional or self.volume_goal is not None
        if not (corrects and self._mesh.is_closed and self._mesh.is_oriented):
            return 0.0
        return self._rest_volume * (self.volume_goal or 1.0)

    @cached_property
    def _rest_volume(self) -> float:
        """Volume of M, in length^3."""
        return enclosed_volume(self._mesh.V, self._faces)

    def volume_deficit(self, V: np.ndarray) -> float:
        """Return :attr:`volume` minus the volume of M' (n, 3), in length^3; 0 where :attr:`volume` is 0."""
        return self.volume - enclosed_volume(V, self._faces) if self.volume else 0.0

    def correct_volume(self, V: np.ndarray) -> np.ndarray:
        """Correct the volume deficit of M' (n, 3): movable vertices move along their normals.

        A proxy has few samples inside regions, and does not know all of the volume there. All vertices far
        from handles move alike, by at most :data:`SHIFT`. M' with a boundary stays, and M' without regions
        and without a goal.
        """
        if not self.volume:
            return V
        most, error = SHIFT * np.sqrt(self._mesh.area / self.vertices), ROUNDING * abs(self.volume)
        return shifted(V, self._faces, self._movable, self.volume, most=most, error=error)

    @cached_property
    def _movable(self) -> np.ndarray:
        """(n,) weights of moves: 0 at hard handles, 1 away from the edges of regions."""
        weight, (vertex, _, phi) = np.ones(self._mesh.n), self._margin
        weight[vertex] *= 1 - phi
        weight[self.fixed] = 0.0
        return weight

    @cached_property
    def _faces(self) -> np.ndarray:
        """(m, 3) uint32: the faces of M."""
        return self._mesh.F.astype(np.uint32)

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

    @cached_property
    def _region(self) -> np.ndarray:
        """(n,) int32: number of the connected region of each hard handle vertex; 0 elsewhere."""
        handles = np.flatnonzero(self.fixed)
        region = np.zeros(self._mesh.n, dtype=np.int32)
        region[handles] = connected_components(self.graph.matrix[handles][:, handles], directed=False)[1]
        return region

    @cached_property
    def _maps(self) -> tuple[np.ndarray, np.ndarray, VertexMaps] | None:
        """Vertices of faces between handles at the edges of regions, and the affine maps around them.

        Between them stands the number of the vertex, -1 if none, for each of the k vertices of edges. None if
        no region has enough surrounded handles for a rotation.
        """
        at_edge, region = flagged(self._edge, self._mesh.n), self._region
        size, edge = (
            np.bincount(region[i], minlength=region.max() + 1) for i in (self._hard_index, self._edge)
        )
        F = self._mesh.F[at_edge[self._mesh.F].any(axis=1)]
        F = F[self.fixed[F].all(axis=1)]
        F = F[(size - edge >= SURROUNDED * size)[region[F[:, 0]]]]
        if len(F) == 0:
            return None
        vertex, F = np.unique(F, return_inverse=True)
        number = numbered(vertex, self._mesh.n)[self._edge]
        return vertex, number, VertexMaps.at_rest(Mesh(self._mesh.V[vertex], F.reshape(-1, 3)))

    @cached_property
    def _margin(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Movable vertices beside the edges, the number of the nearest edge vertex for each, and phi.

        phi is 0 half-way between two regions, where the nearest edge changes, and at soft handles, which the
        solver has placed.
        """
        graph = self.graph
        if len(self._edge) == 0:
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0)
        fronts = Fronts(graph, self._edge)
        distance, nearest = fronts.distance, self._edge[fronts.cell]
        width = WIDTH * np.sqrt(self._mesh.area) * (self.vertices**-0.5 + graph.n**-0.5)
        vertex = np.flatnonzero((distance < width) & ~self.fixed)
        phi = _smooth_fall(distance[vertex] / width)
        nearest_region = self._region[nearest]
        owner = np.repeat(np.arange(graph.n), np.diff(graph.indptr))
        between = np.unique(owner[nearest_region[owner] != nearest_region[graph.indices]])
        between = np.union1d(between, self._handles.index[~self._hard])
        if len(between):
            near, other = distance[vertex], Fronts(graph, between).distance[vertex]
            other = np.minimum(other, np.finfo(float).max)  # infinite on a component without a between
            phi = phi * (1 - _smooth_fall(other / np.maximum(near, other)))
        return vertex, fronts.cell[vertex], phi


def enclosed_volume(V: np.ndarray, F: np.ndarray) -> float:
    """Return the volume inside the faces F (m, 3) of a closed, oriented surface at positions V (n, 3)."""
    origin = V[F[0, 0]]
    return float(sum(in_ranges(volume_and_area, len(F), F, V, origin))[0])


def edge_vertices(mesh: Mesh, index: np.ndarray) -> np.ndarray:
    """Return the handle vertices of `index` (h,) that have a neighbour without a handle."""
    handle = flagged(index, mesh.n)
    near = mesh.connectivity.neighbours
    # The values of the matrix have no meaning; an array of ones would only take memory.
    beside = csr_array((near.indices, near.indices, near.indptr), shape=(mesh.n, mesh.n))[index]
    return index[np.logical_or.reduceat(~handle[beside.indices], beside.indptr[:-1])]


def has_regions(mesh: Mesh, index: np.ndarray, options: Options) -> bool:
    """Whether handles (h,) are :attr:`HandleRegions.regional` on proxies with the given options."""
    vertices = proxy_vertices(options.vertices, mesh.n, len(index), coarser=options.coarser)
    return _are_regions(len(edge_vertices(mesh, index)), len(index), vertices)


def _are_regions(edge: int, handles: int, vertices: int) -> bool:
    """Whether handles are regions, for the numbers of edge handles, of all handles and of proxy vertices."""
    return 2 * edge < handles or 2 * handles > vertices


def _smooth_fall(x: np.ndarray) -> np.ndarray:
    """Fall from 1 at 0 to 0 from 1 on, with slope 0 at both ends."""
    x = np.minimum(x, 1.0)
    return 1 - x * x * (3 - 2 * x)


def all_on_targets(task: DeformationTask) -> DeformationResult:
    """Return the result of a task in which every vertex is a hard handle."""
    V = task.mesh.V.copy()
    V[task.handles.index] = task.handles.target
    facts = Facts(residual=0.0, faces_without_area=int(task.mesh.without_area.sum()))
    return DeformationResult(V, 0, True, facts=facts)


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

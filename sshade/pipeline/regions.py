"""Handles that are regions: their edge is held on the proxy, their inside needs few samples.

A handle vertex whose neighbours are all handles says nothing to the free surface. Where most
handles are such, distances between handle vertices count a third in the sampling: the inside of
a region keeps a sample for every nine of the free surface, which carry its motion, its rotation
at the edge, and its part of the volume. The samples that are handle vertices are the proxy's
handles; the edges themselves are, up to a share of the samples. In the end every hard handle vertex
goes to its target, and the surface beside an edge turns with its region, so that the one continues
the other without the crease that a membrane has where it is clamped. Handles without an inside, as many
single vertices or lines, have no rotation: what they lack is spread over the surface beside them.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from numba import njit
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from sshade.carry.blended import nearest_rotations
from sshade.carry.vertex_maps import VertexMaps
from sshade.handles import Handles
from sshade.mesh.adjacency import VertexGraph
from sshade.mesh.harmonic import harmonic
from sshade.mesh.mesh import Mesh
from sshade.options import Options
from sshade.pipeline.proxies import proxy_vertices
from sshade.sampling.fronts import Fronts, thinned
from sshade.sampling.proxy import Sampling, sample_proxy
from sshade.solver.constraints import ROUNDING, add_gradients, volume_and_area
from sshade.task import DeformationResult, DeformationTask
from sshade.threads import in_ranges

#: Length of an edge between handle vertices, to the sampling, over its own.
INSIDE = 1 / 3
#: Edges have at most one in so many of the samples, but may have the smaller number.
EDGE_SHARE, EDGE_SAMPLES = 4, 100
#: Largest move that makes up for the volume, in distances between samples, and steps to find it.
SHIFT, NEWTON_STEPS = 0.1, 4
#: Handles that hang together have a rotation where at least this share of them has handles around it only.
#: Among single vertices, some triples happen to be faces, whose turn says nothing.
SURROUNDED = 0.1
#: Turns of a region against the surface beside it, in radians: the smaller one is a crease, all of which is
#: taken out of its edge, the larger one a bend, which is left: else one would be elsewhere, with stretch.
CREASE, BEND = 0.3, 0.9
#: Rings of neighbours along an edge over which that turn is a mean.
RINGS = 4
#: Width of the surface beside an edge that turns with its region, in distances between samples and, besides,
#: between vertices.
WIDTH = 3.0


class HandleRegions:
    """The handle vertices of a mesh as its proxies have them.

    Parameters
    ----------
    mesh : Mesh
        M.
    handles : Handles
        Of a task.
    vertices : int
        Of the proxies.
    graph : VertexGraph
        Of M.

    Attributes
    ----------
    vertices, graph
        Those given.
    regional : bool
        More than half of the handles are surrounded by others, or they are more than half of the
        samples. Otherwise every one is a sample, and nothing here does anything.
    covered : bool
        Every vertex is a hard handle.
    number : (n,) int64
        The handle that each vertex is, or -1.
    first : (f,) int64
        The vertices that are to be sampled first.
    metric : VertexGraph
        The graph on which distances are measured to sample the others.
    """

    def __init__(self, mesh: Mesh, handles: Handles, *, vertices: int, graph: VertexGraph) -> None:
        self._mesh, self._handles, self.vertices, self.graph = mesh, handles, vertices, graph
        index, self._hard = handles.index, handles.hard
        self.number = np.full(mesh.n, -1)
        self.number[index] = np.arange(len(index))
        handle = self.number >= 0
        self._index = index[self._hard]
        self._held = np.zeros(mesh.n, dtype=bool)
        self._held[self._index] = True
        self.covered = len(self._index) == mesh.n
        edge = edge_vertices(mesh, index)
        self.regional = _are_regions(len(edge), len(index), vertices)
        self.metric, self.first = graph, index
        self._edge = edge if self._hard.all() else edge_vertices(mesh, self._index)
        if self.regional and not self.covered:
            owner = np.repeat(np.arange(mesh.n), np.diff(graph.indptr))
            inside = handle[owner] & handle[graph.indices]
            self.metric = replace(graph, lengths=np.where(inside, INSIDE, 1.0) * graph.lengths)
            # A hard handle among soft ones is at no edge of all together, but moves them.
            edge = np.concatenate([edge, np.setdiff1d(self._edge, edge)])
            edge = thinned(graph, edge, max(vertices // EDGE_SHARE, EDGE_SAMPLES))
            self.first = np.concatenate([edge, self._one_of_each(edge)])

    def _one_of_each(self, sampled: np.ndarray) -> np.ndarray:
        """A vertex of each group of soft, and of turned handles that has none yet, for their effect."""
        own, there, found = self._handles, self.number[sampled], []
        turned = np.zeros(len(own), dtype=bool)
        if own.rotation is not None:
            turned = np.isfinite(own.rotation).all(axis=(1, 2))
        for kind in (~self._hard, turned):
            groups, first = np.unique(own.group[kind], return_index=True)
            missing = ~np.isin(groups, own.group[there[kind[there]]])
            found.append(own.index[kind][first[missing]])
        return np.union1d(*found)

    def sample(self, seed: int | tuple[int, ...]) -> tuple[Sampling, np.ndarray]:
        """Sample M; also return (k,) int64, the handle that each vertex of the proxy is, or -1.

        Raises
        ------
        InputError
            See :func:`sshade.sampling.proxy.sample_proxy`.
        """
        sampling = sample_proxy(self._mesh, self.vertices, first=self.first, seed=seed, graph=self.metric)
        return sampling, self.number[sampling.samples]

    def on_targets(self, V: np.ndarray, handles: Handles) -> np.ndarray:
        """M' with every hard handle vertex on its target, and the surface beside regions turned with them.

        Parameters
        ----------
        V : (n, 3) float64
            M' as carried.
        handles : Handles
            Those given, at their targets, with their rotations.

        Returns
        -------
        (n, 3) float64
            ``(1 - phi) v' + phi (t_e + R_e (v - v_e))``, with v_e the vertex of an edge that is
            nearest to v, t_e its target, R_e the rotation of the region there, and phi from 1 at
            the edge, where its slope is 0, to 0. R_e is prescribed for the handle, or that of the faces
            between handles; where the surface bends beside these, phi is smaller. Beside handles without
            either, v' moves by the harmonic function that is ``t_e - v_e'`` at them and 0 where phi ends;
            soft handles there follow.
        """
        if not self.regional or len(self._index) == 0:
            return V
        moved = V.copy()
        moved[self._index] = handles.target[self._hard]
        own, nearest, phi = self._beside
        R = self._rotations(moved, handles)
        turned = np.isfinite(R[:, 0, 0])
        turns = turned[nearest]
        v, e = own[turns], nearest[turns]
        arm = self._mesh.V[v] - self._mesh.V[e]
        offset = np.einsum("ijk,ik->ij", R[e], arm) + moved[e] - V[v]
        share = self._shares(e, np.linalg.norm(offset, axis=1), np.linalg.norm(arm, axis=1))
        if known := handles.prescribed_rotations:
            share[np.isin(e, known[0])] = 1.0
        moved[v] += (phi[turns] * share)[:, None] * offset
        free = own[~turns]
        lacking = np.where((self._held & ~turned)[:, None], moved - V, 0.0)
        if len(free) and lacking.any():
            moved[free] += harmonic(self.graph, free, lacking)
        return moved

    def _shares(self, e: np.ndarray, offset: np.ndarray, arm: np.ndarray) -> np.ndarray:
        """(b,) which share of its `offset` (b,) a vertex takes, `arm` (b,) from the vertex e (b,) of an edge.

        It falls from 1 at :data:`CREASE` to 0 at :data:`BEND` with the turn of the region against the
        surface: the mean beside an edge's vertex and those near to it.
        """
        sums = np.stack([np.bincount(e, length, self._mesh.n)[self._edge] for length in (offset, arm)])
        for _ in range(RINGS):
            sums = sums + sums @ self._along
        turn = sums[0] / np.where(sums[1] > 0, sums[1], 1.0)
        share = np.ones(self._mesh.n)
        share[self._edge] = _fall(np.maximum(turn - CREASE, 0.0) / (BEND - CREASE))
        return share[e]

    def prepare(self) -> None:
        """Make what :meth:`on_targets` needs of the rest shape, for which another thread may have time."""
        if self.regional and len(self._index):
            self._beside, self._maps  # noqa: B018 - cached

    @cached_property
    def volume(self) -> float:
        """The volume that M' is to have, in length^3; 0 without regions, or where M encloses none."""
        if not (self.regional and self._mesh.is_closed and self._mesh.is_oriented):
            return 0.0
        return float(self._measured(self._mesh.V)[0])

    def volume_deficit(self, V: np.ndarray) -> float:
        """What :attr:`volume` is more than that of M' (n, 3), in length^3; 0 where that is 0."""
        return self.volume - self._measured(V)[0] if self.volume else 0.0

    def correct_volume(self, V: np.ndarray) -> np.ndarray:
        """M' with the volume of M: free vertices move along their normals, those far from handles alike.

        A proxy with few samples inside of the regions does not know all of the volume there. A
        move is at most :data:`SHIFT`; M' without regions or with a boundary stays.

        Parameters
        ----------
        V : (n, 3) float64
        """
        mesh, (volume, area) = self._mesh, self._measured(V) if self.volume else (0.0, 0.0)
        lacking = self.volume - volume
        if lacking == 0.0:
            return V
        G = np.zeros((mesh.n, 3))
        add_gradients(mesh.F.astype(np.uint32), V - mesh.origin, 1.0, 0.0, G, G, 0, mesh.n)
        length = np.linalg.norm(G, axis=1, keepdims=True)
        Z = np.divide(G, length, out=np.zeros((mesh.n, 3)), where=length > 0)
        own, _, phi = self._beside
        Z[own] *= 1 - phi[:, None]
        Z[self._held] = 0.0
        slope, shift = float((G * Z).sum()), 0.0
        most = SHIFT * np.sqrt(area / self.vertices)
        for _ in range(NEWTON_STEPS if slope > 0 else 0):
            shift = float(np.clip(shift + lacking / slope, -most, most))
            lacking = self.volume_deficit(V + shift * Z)
            if abs(lacking) <= ROUNDING * abs(self.volume):
                break
        return V + shift * Z

    def _measured(self, V: np.ndarray) -> np.ndarray:
        """(2,) volume and area at positions V (n, 3)."""
        F, origin = self._mesh.F, V[self._mesh.F[0, 0]]
        return sum(in_ranges(lambda first, end: volume_and_area(first, end, F, V, origin), len(F)))

    def _rotations(self, moved: np.ndarray, handles: Handles) -> np.ndarray:
        """(n, 3, 3) rotations of the regions at the vertices of their edges, NaN where there is none."""
        R = np.full((self._mesh.n, 3, 3), np.nan)
        if self._maps:
            vertex, maps = self._maps
            R[vertex] = nearest_rotations(maps(moved[vertex])[0])
        if known := handles.prescribed_rotations:
            R[known[0]] = known[1]
        return R

    @cached_property
    def _along(self) -> csr_array:
        """(e, e) 1 for neighbours among the vertices of edges."""
        along = self.graph.matrix[self._edge][:, self._edge]
        along.data[:] = 1.0
        return along

    @cached_property
    def _region(self) -> np.ndarray:
        """(n,) int32: for each handle vertex which set of them it hangs together with; others are in 0."""
        handles = np.flatnonzero(self._held)
        region = np.zeros(self._mesh.n, dtype=np.int32)
        region[handles] = connected_components(self.graph.matrix[handles][:, handles], directed=False)[1]
        return region

    @cached_property
    def _maps(self) -> tuple[np.ndarray, VertexMaps] | None:
        """Vertices of faces between handles at the edges of regions, and the affine maps around them.

        None where no region has enough of an inside for a rotation.
        """
        at_edge, region = np.zeros(self._mesh.n, dtype=bool), self._region
        at_edge[self._edge] = True
        size, edge = (np.bincount(region[i], minlength=region.max() + 1) for i in (self._index, self._edge))
        F = self._mesh.F[at_edge[self._mesh.F].any(axis=1)]
        F = F[self._held[F].all(axis=1)]
        F = F[(size - edge >= SURROUNDED * size)[region[F[:, 0]]]]
        if len(F) == 0:
            return None
        vertex, F = np.unique(F, return_inverse=True)
        return vertex, VertexMaps.at_rest(Mesh(self._mesh.V[vertex], F.reshape(-1, 3)))

    @cached_property
    def _beside(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Free vertices beside the edges, for each the nearest vertex of an edge, and phi.

        Half-way between two regions phi falls to 0, as the nearest of them changes there, and
        towards soft handles, which the solver has pulled to where they are: none turns with a region.
        """
        graph, held = self.graph, self._held
        if len(self._edge) == 0:
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0)
        fronts = Fronts(graph, self._edge)
        distance, nearest = fronts.distance, self._edge[fronts.cell]
        width = WIDTH * np.sqrt(self._mesh.area) * (self.vertices**-0.5 + graph.n**-0.5)
        own = np.flatnonzero((distance < width) & ~held)
        phi = _fall(distance[own] / width)
        nearest_region = self._region[nearest]
        owner = np.repeat(np.arange(graph.n), np.diff(graph.indptr))
        between = np.unique(owner[nearest_region[owner] != nearest_region[graph.indices]])
        between = np.union1d(between, self._handles.index[~self._hard])
        if len(between):
            own_distance, other = distance[own], Fronts(graph, between).distance[own]
            phi = phi * (1 - _fall(other / np.maximum(own_distance, other)))
        return own, nearest[own], phi


def edge_vertices(mesh: Mesh, index: np.ndarray) -> np.ndarray:
    """Those of some handle vertices (h,) that have a free neighbour."""
    held = np.zeros(mesh.n, dtype=bool)
    held[index] = True
    near = mesh.connectivity.neighbours
    return index[_beside_free(index, held, near.indptr, near.indices)]


def has_regions(mesh: Mesh, index: np.ndarray, options: Options) -> bool:
    """Whether handles (h,) are :attr:`HandleRegions.regional` on proxies with these options."""
    vertices = proxy_vertices(options.vertices, mesh.n, len(index), coarser=options.coarser)
    return _are_regions(len(edge_vertices(mesh, index)), len(index), vertices)


def _are_regions(edge: int, handles: int, vertices: int) -> bool:
    return 2 * edge < handles or 2 * handles > vertices


def _fall(x: np.ndarray) -> np.ndarray:
    """From 1 at 0 to 0 at 1 and beyond, with slope 0 at both."""
    x = np.minimum(x, 1.0)
    return 1 - x * x * (3 - 2 * x)


def all_on_targets(task: DeformationTask) -> DeformationResult:
    """The result of a task that leaves no vertex free."""
    V = np.empty((task.mesh.n, 3))
    V[task.handles.index] = task.handles.target
    facts = {"samples": 0, "proxy_vertices": 0, "degenerate_frames": 0, "residual": 0.0}
    facts["faces_without_area"] = int(task.mesh.without_area.sum())
    return DeformationResult(V, 0, True, {}, facts)


@njit(cache=True, nogil=True)
def _beside_free(index, held, indptr, indices):
    found = np.zeros(len(index), dtype=np.bool_)
    for h in range(len(index)):
        for p in range(indptr[index[h]], indptr[index[h] + 1]):
            found[h] = found[h] or not held[indices[p]]
    return found

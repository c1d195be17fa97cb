"""Handles that are regions: few samples inside, the surface turned with their edges, the volume corrected.

A handle vertex whose neighbours are all handles tells the surface outside nothing. Where most handles are of
this kind, the sampling counts a third of each distance between handle vertices. The inside of a region then
keeps one sample for every nine outside. The samples inside determine the motion, rotation and volume of the
region. Samples that are handle vertices are the proxy's handles; up to a quarter of all samples lie on edges.

In the end every hard handle vertex goes to its target, and the surface beside it follows
(:mod:`sshade.regions.region_edges`). The volume of M' is corrected.

Single handles that lie all over the surface are dense: nearly all of it is near one of them.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from sshade.mesh.adjacency import VertexGraph
from sshade.mesh.incidence import flagged, numbered
from sshade.mesh.mesh import Mesh
from sshade.problem.facts import Facts
from sshade.problem.handles import Handles
from sshade.problem.options import Options
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.proxy.fronts import thinned
from sshade.proxy.sample import proxy_vertices
from sshade.regions.normal_shift import shifted
from sshade.regions.region_edges import RegionEdges
from sshade.solver.constraints import ROUNDING, enclosed_volume

#: Length of an edge between handle vertices in the sampling, as a fraction of its length.
INSIDE = 1 / 3
#: At most a quarter of the samples, or 100 if more, lie on region edges.
EDGE_RATIO, EDGE_SAMPLES = 4, 100
#: Largest move of a vertex by the volume correction, in distances between samples.
SHIFT = 0.1
#: Number of vertices at which the distance to the handles is measured, and the quantile of their area.
PROBES, NEARLY_ALL = 20_000, 0.95
#: Distance to the nearest handle up to which handles are dense, as a fraction of the square root of the area.
DENSE = 0.05


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
        self._hard_index = index[self._hard]
        self.fixed = flagged(self._hard_index, mesh.n)
        self.covered = bool(handles.hard.sum() == mesh.n)
        edge = edge_vertices(mesh, index)
        self.regional = _are_regions(len(edge), len(index), vertices)
        self.metric, self.first = graph, index
        #: Hard handle vertices on the edges of regions.
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

    @cached_property
    def _edges(self) -> RegionEdges:
        soft = self._handles.index[~self._hard]
        return RegionEdges(
            self._mesh, self.graph, vertices=self.vertices, edge=self._edge, fixed=self.fixed, soft=soft
        )

    def on_targets(self, V: np.ndarray, handles: Handles) -> np.ndarray:
        """Move every hard handle vertex to its target, and turn the surface beside regions with them.

        Parameters
        ----------
        V : (n, 3) float64
            M', prolonged from the proxy.
        handles : Handles
            At their targets, with their rotations.
        """
        if not self.regional or len(self._hard_index) == 0:
            return V
        moved = V.copy()
        moved[self._hard_index] = handles.target[self._hard]
        self._edges.move_beside(moved, V, handles)
        return moved

    def prepare(self) -> None:
        """Compute the rest-shape data of :meth:`on_targets`, in a thread that has time."""
        if self.regional and len(self._hard_index):
            self._edges.prepare()

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
        weight, (vertex, _, phi) = np.ones(self._mesh.n), self._edges.margin
        weight[vertex] *= 1 - phi
        weight[self.fixed] = 0.0
        return weight

    @cached_property
    def _faces(self) -> np.ndarray:
        """(m, 3) uint32: the faces of M."""
        return self._mesh.F.astype(np.uint32)


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


def are_dense(task: DeformationTask) -> bool:
    """Whether nearly all of the surface is near handles of a kind that can be interpolated.

    Regions, whose handles are mostly inside of the region, are not dense handles.
    """
    handles, mesh = task.handles, task.mesh
    if not mesh.area or not hard_positions_alone(task):
        return False
    if 2 * len(edge_vertices(mesh, handles.index)) < len(handles):
        return False
    return distance_to_handles(task) <= DENSE * float(np.sqrt(mesh.area))


def hard_positions_alone(task: DeformationTask) -> bool:
    """Whether all handles are hard and none has a rotation."""
    handles = task.handles
    return handles.prescribed_rotations is None and bool(handles.hard.all())


def distance_to_handles(task: DeformationTask) -> float:
    """Return the distance to the nearest handle that nearly all of the surface has at most."""
    mesh = task.mesh
    probes = np.linspace(0, mesh.n - 1, min(PROBES, mesh.n)).astype(np.int64)
    distance, _ = cKDTree(mesh.V[task.handles.index]).query(mesh.V[probes])
    order, area = np.argsort(distance), mesh.vertex_areas[probes]
    below = np.cumsum(area[order]) / area.sum()
    return float(distance[order[np.searchsorted(below, NEARLY_ALL)]])


def all_on_targets(task: DeformationTask) -> DeformationResult:
    """Return the result of a task in which every vertex is a hard handle."""
    V = task.mesh.V.copy()
    V[task.handles.index] = task.handles.target
    facts = Facts(residual=0.0, faces_without_area=int(task.mesh.without_area.sum()))
    return DeformationResult(V, 0, True, facts=facts)

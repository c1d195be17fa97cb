"""Handles that are regions: their edge is held on the proxy, their inside needs few samples.

A handle vertex whose neighbours are all handles says nothing to the free surface. Where most
handles are such, distances between handle vertices count a quarter in the sampling: the inside of
a region keeps a sample for every sixteen of the free surface, which carry its motion, its rotation
at the edge, and its part of the volume. The samples that are handle vertices are the proxy's
handles. An edge of more vertices than a share of the samples is thinned; what the proxy leaves of
its targets is then spread over the surface beside it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from sshade.mesh.adjacency import VertexGraph
from sshade.mesh.mesh import Mesh
from sshade.sampling.fronts import Fronts, thinned
from sshade.sampling.remesh import Remesh, remesh
from sshade.solver.factorisation import Factorisation
from sshade.task import DeformationResult, DeformationTask

#: Length of an edge between handle vertices, to the sampling, over its own.
INSIDE = 0.25
#: The samples that a region's edge may have, as one in so many.
EDGE_SHARE = 4
#: Width of the surface over which a thinned edge is corrected, in distances between its samples.
REACH = 2.0


class HandleRegions:
    """The handle vertices of a mesh as its proxies have them.

    Parameters
    ----------
    mesh : Mesh
        M.
    index : (h,) int
        Its handle vertices, each once.
    vertices : int
        Of the proxies.
    graph : VertexGraph
        Of M.

    Attributes
    ----------
    regional : bool
        More than half of the handles are surrounded by others, or they are more than half of the
        samples. Otherwise every one is a sample, and nothing here does anything.
    covered : bool
        No vertex is free.
    """

    def __init__(self, mesh: Mesh, index: np.ndarray, *, vertices: int, graph: VertexGraph) -> None:
        self._mesh, self._index, self._vertices, self._graph = mesh, index, vertices, graph
        self._number = np.full(mesh.n, -1)
        self._number[index] = np.arange(len(index))
        self._held = self._number >= 0
        self.covered = bool(self._held.all())
        owner = np.repeat(np.arange(mesh.n), np.diff(graph.indptr))
        beside_free = np.zeros(mesh.n, dtype=bool)
        beside_free[owner[~self._held[graph.indices]]] = True
        self._edge = index[beside_free[index]]
        self.regional = 2 * len(self._edge) < len(index) or 2 * len(index) > vertices
        self._metric, self._first = graph, index
        if self.regional and not self.covered:
            inside = self._held[owner] & self._held[graph.indices]
            self._metric = replace(graph, lengths=np.where(inside, INSIDE, 1.0) * graph.lengths)
            self._first = thinned(graph, self._edge, max(vertices // EDGE_SHARE, 1))

    def sample(self, seed: int | tuple[int, ...]) -> tuple[Remesh, np.ndarray]:
        """Sample M; also return (k,) int64, the handle that each vertex of the proxy is, or -1.

        Raises
        ------
        InputError
            See :func:`sshade.sampling.remesh.remesh`.
        """
        remeshed = remesh(self._mesh, self._vertices, first=self._first, seed=seed, graph=self._metric)
        return remeshed, self._number[remeshed.samples]

    def on_targets(self, V: np.ndarray, targets: np.ndarray) -> np.ndarray:
        """M' with every handle vertex on its target.

        Parameters
        ----------
        V : (n, 3) float64
            M' as carried.
        targets : (h, 3) float64
            In the order of the handle vertices.
        """
        if not self.regional:
            return V
        moved = V.copy()
        moved[self._index] = targets
        if len(self._first) < len(self._edge):
            band, to_edge, system = self._beside_edge
            moved[band] += system.solve(to_edge @ (moved - V)[self._edge])
        return moved

    @cached_property
    def _beside_edge(self) -> tuple[np.ndarray, csr_array, Factorisation]:
        """The free vertices near a thinned edge, and the harmonic extension from the edge to them."""
        graph = self._graph
        spacing = Fronts(graph, self._first).distance[self._edge].max()
        near = Fronts(graph, self._edge).distance < REACH * spacing
        band = np.flatnonzero(near & ~self._held)
        floor = 1e-3 * graph.lengths.mean()
        weights = graph.matrix
        weights.data = 1.0 / np.maximum(weights.data, floor)
        rows = weights[band]
        diagonal = csr_array((rows.sum(axis=1), (np.arange(len(band)),) * 2))
        return band, rows[:, self._edge], Factorisation(diagonal - rows[:, band])


def all_on_targets(task: DeformationTask) -> DeformationResult:
    """The result of a task that leaves no vertex free."""
    V = np.empty((task.mesh.n, 3))
    V[task.handles.index] = task.handles.target
    facts = {"proxy_vertices": 0, "degenerate_frames": 0, "residual": 0.0}
    return DeformationResult(V, 0, True, {}, facts)

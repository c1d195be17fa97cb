"""Fast ARAP on a deformation graph, from the description of Morsucci et al.; no public code was found.

The method solves ARAP on a coarse graph of nodes on the mesh, and blends the rigid motions of the nodes over
the mesh. Nodes i, with positions p_i at rest and q_i deformed, minimise

    sum_i sum_{j ~ i} w_ij |(q_i - q_j) - R_i (p_i - p_j)|^2,   w_ij = 1.

A vertex x moves to ``sum_m phi_m(x) (R_m (x - p_m) + q_m)``, summed over its K nearest nodes. The weights
phi_m are ``(1 - d_m / d_max)^2`` divided by their sum. d_m is the distance along the surface, and d_max the
distance of the next node (Sumner et al.).

The paper does not say how to choose nodes and edges. Here, farthest point sampling from the handles gives the
nodes, and an edge connects two nodes whose Voronoi cells share a mesh edge. Unlike SShaDe's proxy, the graph
has no triangles and needs no topology repair.

Morsucci et al., 2018 (fast ARAP). R. W. Sumner, J. Schmid, M. Pauly, "Embedded
deformation for shape manipulation", 2007.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from baselines.deformation_graph.node_graph import NodeGraph, bind_to_nodes, node_graph
from baselines.iteration import iterate, iterated
from baselines.stopwatch import Stopwatch
from sshade.errors import InputError
from sshade.mesh.adjacency import vertex_graph
from sshade.options import Start
from sshade.pipeline.proxies import proxy_vertices
from sshade.pipeline.regions import HandleRegions, all_on_targets
from sshade.progress import Progress, silent
from sshade.sampling.fronts import farthest_point_sampling
from sshade.solver.cotangents import laplacian_matrix
from sshade.solver.linear import Factorised
from sshade.solver.rotations import fit_rotations
from sshade.solver.run import Stop
from sshade.solver.start import initial_guess
from sshade.solver.terms.arap import Edges, covariances, forces
from sshade.task import DeformationResult, DeformationTask


def deformation_graph(
    task: DeformationTask,
    *,
    nodes: int = 1000,
    blended: int = 4,
    tolerance: float = 1e-5,
    max_iterations: int = 1000,
    start: Start = "rest",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Deform with ARAP on a graph of nodes and blend the nodes' rigid motions over the mesh.

    Parameters
    ----------
    task : DeformationTask
        The mesh must be manifold and oriented. It may have a boundary and several components.
    nodes : int
        k, number of nodes. Each handle vertex is a node, except inside handle regions (see
        :class:`sshade.pipeline.regions.HandleRegions`). A small mesh has one node for four vertices (see
        :func:`sshade.pipeline.proxies.proxy_vertices`).
    blended : int
        K, number of nodes that move a vertex, at least 1: the nearest nodes along the surface among the node
        of its Voronoi cell and the neighbours of this node in the graph.
    tolerance : float
        Residual below which the iteration stops: the largest move of a node in one iteration, divided by the
        mesh's bounding-box diagonal. 0 disables the test.
    max_iterations : int
    start : {"rest", "rigid"}
        See :func:`sshade.solver.start.initial_guess`.
    seed : int
        Unused, because the sampling begins with the handles.
    progress : Progress

    Returns
    -------
    DeformationResult
        Handle vertices are put on their targets at the end. ``extra`` holds ``handle_before``, their mean
        distance to the targets before this correction divided by the diagonal, ``nodes``, ``edges`` and
        ``residual``.

    Raises
    ------
    InputError
        If the mesh is not manifold and oriented, the start is unknown, there are fewer nodes than handles,
        `blended` is below 1, or a handle is soft.
    """
    if blended < 1:
        raise InputError(f"blended={blended} is out of range; at least one node must move a vertex")
    watch = Stopwatch()
    mesh, handles = task.mesh, task.handles
    handles.require_hard("the deformation graph")
    graph = vertex_graph(mesh)
    nodes = proxy_vertices(nodes, mesh.n, len(handles))
    regions = HandleRegions(mesh, handles, vertices=nodes, graph=graph)
    if regions.covered:
        return all_on_targets(task)
    fronts = farthest_point_sampling(regions.metric, nodes, first=regions.first)
    handle = regions.number[fronts.samples]
    fixed = np.flatnonzero(handle >= 0)
    coarse = node_graph(mesh, fronts)
    bound = bind_to_nodes(graph, fronts, edges=coarse.edges, blended=blended)
    watch.end("precompute")

    q = initial_guess(task, start)[fronts.samples]
    solver = _NodeSolver(coarse, fixed=fixed)
    stop = Stop(tolerance, max_iterations)
    done = iterate(solver.advance, q, stop, diagonal=mesh.diagonal, progress=progress)
    R = solver.rotations(q)
    watch.end("solve")

    V = np.empty((mesh.n, 3))
    _blend(mesh.V, bound.node, bound.weight, coarse.P, q, R, V)
    missed = np.linalg.norm(V[handles.index] - handles.target, axis=1)
    V = regions.on_targets(V, handles)
    V[handles.index] = handles.target
    watch.end("carry")
    facts = {
        "handle_before": float(missed.mean()) / mesh.diagonal,
        "nodes": len(q),
        "edges": len(coarse.edges),
    }
    return iterated(V, done, watch.seconds, **facts)


class _NodeSolver:
    """Local and global steps on a node graph."""

    def __init__(self, coarse: NodeGraph, *, fixed: np.ndarray) -> None:
        k, edges = len(coarse.P), coarse.edges
        weights = np.ones(len(edges))
        Y = np.ascontiguousarray((coarse.P[edges[:, 0]] - coarse.P[edges[:, 1]])[:, None])
        self._elements = Edges(edges.astype(np.int32), Y, weights[:, None])
        self._Q, self._R, self._B = np.tile([1.0, 0.0, 0.0, 0.0], (k, 1)), np.empty((k, 9)), np.empty((k, 3))
        self._linear = Factorised(laplacian_matrix(k, edges, weights), fixed)

    def rotations(self, q: np.ndarray) -> np.ndarray:
        """Return the rotations (k, 9) of the local step at q."""
        covariances(self._elements, q, self._R, 0, len(q))
        fit_rotations(self._R, self._Q)
        return self._R

    def advance(self, q: np.ndarray, out: np.ndarray) -> None:
        """Write the result of one local and one global step to `out`."""
        forces(self._elements, q, self.rotations(q), self._B, 0, len(q))
        self._linear.solve(self._B, out)
        out += q


@njit(cache=True, nogil=True)
def _blend(V, node, weight, P, q, R, out):
    for i in range(len(V)):
        for r in range(3):
            out[i, r] = 0.0
        for c in range(node.shape[1]):
            m, phi = node[i, c], weight[i, c]
            if phi == 0.0:
                continue
            x, y, z = V[i, 0] - P[m, 0], V[i, 1] - P[m, 1], V[i, 2] - P[m, 2]
            for r in range(3):
                out[i, r] += phi * (R[m, 3 * r] * x + R[m, 3 * r + 1] * y + R[m, 3 * r + 2] * z + q[m, r])

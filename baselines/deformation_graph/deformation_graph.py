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

Proof: the formulas above in a dense implementation (tests/baselines/test_deformation_graph.py).

Morsucci et al., 2018 (fast ARAP). R. W. Sumner, J. Schmid, M. Pauly, "Embedded
deformation for shape manipulation", 2007.
"""

from __future__ import annotations

import numpy as np

from baselines.deformation_graph.node_graph import bind_to_nodes, node_graph
from baselines.hard_handles import require_hard
from baselines.iteration import Plain, handle_error, iterated
from baselines.local_step import LocalStep, blend, spokes
from baselines.stopwatch import Stopwatch
from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.mesh.adjacency import vertex_graph
from sshade.problem.options import Start, Stop
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.proxy.fronts import farthest_point_sampling
from sshade.proxy.sample import proxy_vertices
from sshade.regions.handle_regions import HandleRegions, all_on_targets
from sshade.solver.aim import initial_guess
from sshade.solver.factorisation import Factorised
from sshade.solver.laplacian import laplacian_matrix
from sshade.solver.run import run


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
        The mesh must be manifold and oriented. It may have a boundary and several components, each
        with a handle.
    nodes : int
        k, number of nodes. Each handle vertex is a node, except inside handle regions (see
        :class:`sshade.regions.handle_regions.HandleRegions`). A small mesh has one node for four vertices
        (see :func:`sshade.proxy.sample.proxy_vertices`).
    blended : int
        K, number of nodes that move a vertex, at least 1: the nearest nodes along the surface among the node
        of its Voronoi cell and the neighbours of this node in the graph.
    tolerance : float
        Residual below which the iteration stops: the largest move of a node in one iteration, divided by the
        mesh's bounding-box diagonal. 0 disables the test.
    max_iterations : int
    start : {"rest", "rigid"}
        See :func:`sshade.solver.aim.initial_guess`.
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
        `blended` is below 1, a handle is soft, or a component has no handle or no node.
    """
    if blended < 1:
        raise InputError(f"blended={blended} is out of range; at least one node must move a vertex")
    watch = Stopwatch()
    mesh, handles = task.mesh, task.handles
    require_hard(handles, "the deformation graph")
    mesh.require_handles(handles.index)
    mesh.require_manifold()
    graph = vertex_graph(mesh)
    nodes = proxy_vertices(nodes, mesh.n, len(handles))
    regions = HandleRegions(mesh, handles, vertices=nodes, graph=graph)
    if regions.covered:
        return all_on_targets(task)
    fronts = farthest_point_sampling(regions.metric, nodes, first=regions.first)
    if np.isinf(fronts.distance).any():
        raise InputError(f"{nodes} nodes leave a component of the mesh without one; ask for more")
    fixed = np.flatnonzero(regions.number[fronts.samples] >= 0)
    P, edges = mesh.V[fronts.samples], node_graph(mesh, fronts)
    phi = bind_to_nodes(graph, fronts, edges=edges, blended=blended)
    watch.end("precompute")

    q, weights = initial_guess(task, start)[fronts.samples], np.ones(len(edges))
    linear = Factorised(laplacian_matrix(len(P), edges, weights), fixed)
    local = LocalStep(spokes(P, edges, weights), len(P))

    def advance(q: np.ndarray, out: np.ndarray) -> None:
        local.rotations(q)
        linear.solve(local.forces(q), out)
        out += q

    state = Plain(advance, q, diagonal=mesh.diagonal)
    done = run(state, Stop(tolerance, max_iterations), progress=progress)
    R = local.rotations(q)
    watch.end("solve")

    V = blend(phi, mesh.V, rest=P, nodes=q, R=R)
    before = handle_error(mesh, handles, V)
    V = regions.on_targets(V, handles)
    V[handles.index] = handles.target
    watch.end("carry")
    facts = {"handle_before": before, "nodes": len(q), "edges": len(edges)}
    return iterated(V, done, watch.seconds, facts)

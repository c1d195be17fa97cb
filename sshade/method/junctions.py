"""Junctions: vertices at which a cut mesh has several copies. One solve of all components places them.

Samples of a junction are one vertex of the proxy, so that the components' proxies are joined to one proxy,
which need not be manifold. The as-rigid-as-possible energy needs no orientation: its minimum on the joined
proxy says where junctions go, and where the deformation of each component begins.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from sshade.core.errors import InputError
from sshade.core.progress import Progress, renamed
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.incidence import numbered
from sshade.mesh.mesh import Mesh
from sshade.method.proxy_solver import ProxySolver
from sshade.problem.options import Options
from sshade.problem.task import Handles
from sshade.proxy.bind import sample_components
from sshade.proxy.binding import bind_proxy, frame_maker
from sshade.proxy.fronts import thinned
from sshade.proxy.sample import Sampling
from sshade.regions.handle_regions import EDGE_RATIO, edge_vertices

log = logging.getLogger(__name__)

#: Number of vertices of the joined proxy. Proxies of the components with all their vertices follow.
VERTICES = 3000


def deform_joined(
    parts: Mesh,
    vertex: np.ndarray,
    junction: np.ndarray,
    handles: Handles,
    options: Options,
    *,
    guess: np.ndarray | None,
    progress: Progress,
) -> np.ndarray:
    """Deform components through one proxy that is joined at junctions.

    Volume and area are unconstrained.

    Parameters
    ----------
    parts : Mesh
        The components: an oriented manifold.
    vertex : (n,) int64
        Vertex of the uncut mesh of each vertex.
    junction : (n,) bool
        Copies of junctions. Each component is joined to a component with handles.
    handles : Handles
        On all copies of the handle vertices.
    options : Options
    guess : (n, 3) float64, optional
        Shape in which the solve starts.
    progress : Progress

    Returns
    -------
    (n, 3) float64
        Positions; copies of a junction are near each other.

    Raises
    ------
    InputError
        If a component cannot be sampled with `options.vertices`, or the joined proxy cannot be solved.
    """
    sampling = _sampled(parts, _first_samples(parts, vertex, junction, handles), options)
    samples = sampling.samples
    name = np.where(junction[samples], vertex[samples], vertex.max() + 1 + samples)
    _, one, number = np.unique(name, return_index=True, return_inverse=True)
    F = number[sampling.faces]
    F = F[(np.roll(F, 1, axis=1) != F).all(axis=1)]  # a face may have two copies of one junction
    proxy = Mesh(parts.V[samples[one]], F)
    handle = numbered(handles.index, parts.n)
    on = np.flatnonzero(handle[samples] >= 0)
    on_proxy = handles.sampled(handle[samples[on]], number[on], parts.V)
    free = replace(options.of_proxy(), volume=0.0, area=0.0, stiffness=1.0, thickness=0.0, proxy_method=None)
    start = None if guess is None else guess[samples[one]]
    solver = ProxySolver(proxy, free, guess=start, progress=renamed(progress, "junctions"))
    solved = solver.solve(on_proxy, volume_goal=1.0, stop=free.stop)
    assert solved.rotations is not None
    binding = bind_proxy(parts, sampling, frames=frame_maker("blended"))
    return binding.carry(solved.positions[number], rotations=solved.rotations[number])[0]


def _sampled(parts: Mesh, first: np.ndarray, options: Options) -> Sampling:
    """Sample all components, more finely where a coarse proxy cannot have their topology."""
    asked = min(options.vertices, parts.n)
    try:
        return sample_components(parts, min(VERTICES, asked), first=first, seed=options.seed)
    except InputError as error:
        if asked <= VERTICES:
            raise
        log.info("junctions are placed by a proxy of %d vertices: %s", asked, error)
    return sample_components(parts, asked, first=first, seed=options.seed)


def _first_samples(parts: Mesh, vertex: np.ndarray, junction: np.ndarray, handles: Handles) -> np.ndarray:
    """Choose the copies (f,) of junctions and the handles that must be samples, at most a quarter of each.

    One junction of each set of components and one handle of each component and group are always among them.
    """
    most, graph = VERTICES // EDGE_RATIO, vertex_graph(parts)
    copies, component = np.flatnonzero(junction), parts.component
    _, place, own = np.unique(vertex[copies], return_index=True, return_inverse=True)
    # Junctions of the same components have the same sum of random numbers, one number a component.
    entries = np.random.default_rng(0).random(component.max() + 1)[component[copies]]
    _, joins = np.unique(np.bincount(own, entries), return_index=True)
    spread = np.union1d(thinned(graph, copies[place], most), copies[place[joins]])
    chosen = copies[np.isin(vertex[copies], vertex[spread])]
    edge = thinned(graph, edge_vertices(parts, handles.index), most)
    pairs = np.stack([component[handles.index], handles.group, handles.hard])
    _, one = np.unique(pairs, axis=1, return_index=True)
    return np.unique(np.concatenate([chosen, edge, handles.index[one]]))

"""Compile kernels before the clock starts: run each method once on a tiny task."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import igl
import numpy as np
from scipy.spatial import ConvexHull

from eval.metrics import Task
from eval.run.targets import instantiate, settings
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.mesh import Mesh
from sshade.method.call import deform
from sshade.problem.task import DeformationTask, Handles, TransferTask
from sshade.proxy.coarse import sample_coarsely

_done: set[str] = set()


def warm_up(config: Mapping[str, Any], *, kind: type[Task]) -> None:
    """Run a method once on a tiny task, unless this process has done so for its settings.

    Methods of :func:`sshade.deform` use other kernels for handle regions and large meshes. For these methods,
    the warm-up also runs :func:`tiny_regions` and :func:`compile_sampling`.

    Parameters
    ----------
    config : mapping
        Configuration of the method. Its ``warm_up`` has parameters that shrink the work, such as the size of
        the proxy. Other settings may need other kernels.
    kind : type
        Chooses :func:`tiny_transfer` or :func:`tiny_task`.
    """
    key = repr(settings(config))
    if key in _done:
        return
    method = instantiate({**config, **config.get("warm_up", {}), "_partial_": True})
    method(tiny_transfer() if kind is TransferTask else tiny_task(), seed=0)
    if method.func is deform:
        if kind is DeformationTask:
            method(tiny_regions(), seed=0)
        compile_sampling()
    _done.add(key)


def compile_sampling() -> None:
    """Compile the kernels that sample large meshes and refine samplings, on a small mesh."""
    mesh, first = tiny_task().mesh, np.array([0])
    sample_coarsely(mesh, vertex_graph(mesh), 20, first=first).insert(np.array([1]))


def tiny_task() -> DeformationTask:
    """Return an icosphere of 642 vertices: one cap is fixed, the opposite cap is turned and lifted."""
    return _two_caps(icosphere(3), low=-0.9, height=0.9, degrees=20, lift=0.1)


def tiny_regions() -> DeformationTask:
    """Return an icosphere of 10,242 vertices, enough for multigrid: a tenth is fixed, two fifths are lifted.

    So few are fixed, and they are lifted so little, that the volume does not yield, and is corrected.
    """
    return _two_caps(icosphere(5), low=-0.8, height=0.2, degrees=0, lift=0.02)


def _two_caps(mesh: Mesh, *, low: float, height: float, degrees: float, lift: float) -> DeformationTask:
    """Fix the vertices of a unit ball below `low`; turn and lift the vertices above `height`."""
    static, dynamic = np.flatnonzero(mesh.V[:, 2] < low), np.flatnonzero(mesh.V[:, 2] > height)
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    moves = np.repeat([False, True], [len(static), len(dynamic)])
    handles = Handles(
        index=np.concatenate([static, dynamic]),
        target=np.concatenate([mesh.V[static], mesh.V[dynamic] @ turn.T + [0, 0, lift]]),
        dynamic=moves,
        group=moves.astype(int),
    )
    return DeformationTask(name="icosphere", mesh=mesh, handles=handles)


def tiny_transfer() -> TransferTask:
    """Return the transfer of a bend to a sphere of 642 vertices with a bump at its top."""
    mesh = icosphere(3)
    x, y, z = mesh.V.T
    bump = Mesh(mesh.V * (1 + 0.2 * np.maximum(0, z) ** 4)[:, None], mesh.F)
    return TransferTask("icosphere", bump, mesh, np.stack([x + 0.3 * z**2, y, z], axis=1))


def icosphere(levels: int) -> Mesh:
    """Return an icosahedron, subdivided `levels` times, with its vertices on the unit sphere."""
    golden = (1 + np.sqrt(5)) / 2
    V = np.array([[s, t * golden, 0] for s in (-1, 1) for t in (-1, 1)])
    V = np.concatenate([np.roll(V, shift, axis=1) for shift in range(3)])
    F = ConvexHull(V).simplices.astype(np.int64)
    inward = np.linalg.det(V[F]) < 0
    F[inward] = F[inward][:, ::-1]
    for level in range(levels + 1):
        V /= np.linalg.norm(V, axis=1, keepdims=True)
        if level < levels:
            V, F = igl.upsample(V, F)
    return Mesh(V, F)

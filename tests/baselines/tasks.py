"""Deformation tasks for the tests of the baselines."""

from __future__ import annotations

import numpy as np

from sshade.mesh.mesh import Mesh
from sshade.task import DeformationTask, Handles
from tests.shapes import QUARTER


def bent_bar(subdivisions: int) -> DeformationTask:
    """A jittered 4 x 1 x 1 bar, one end turned by 90 degrees: 386, 1538, 6146 vertices for 3, 4, 5."""
    import trimesh  # the jitter of a vertex depends on its place in the order

    bar = trimesh.creation.box(extents=(4, 1, 1))
    for _ in range(subdivisions):
        bar = bar.subdivide()
    mesh = Mesh(bar.vertices, bar.faces)
    noise = np.random.default_rng(0).normal(size=mesh.V.shape)
    mesh = Mesh(mesh.V + noise * 0.15 / 2**subdivisions, mesh.F)
    held = np.flatnonzero(np.abs(mesh.V[:, 0]) > 1.9)
    turned = mesh.V[held, 0] > 1.9
    target = np.where(turned[:, None], mesh.V[held] @ QUARTER.T, mesh.V[held])
    return DeformationTask("bar", mesh, Handles(held, target, dynamic=turned, group=turned.astype(int)))


def errors(task: DeformationTask, V: np.ndarray) -> np.ndarray:
    """Area, volume and mean edge error in percent, the last over the longest rest edge."""
    rest, deformed = task.mesh, Mesh(V, task.mesh.F)
    before, after = (np.linalg.norm(np.diff(P[rest.edges], axis=1)[:, 0], axis=1) for P in (rest.V, V))
    area, volume = deformed.area / rest.area - 1, deformed.volume / rest.volume - 1
    return 100 * np.abs([area, volume, np.abs(after - before).mean() / before.max()])

"""Distances to the ground truth agree with brute force, and each task gets the metrics that fit it."""

import numpy as np
import pytest
from eval_cases import ends_task

from eval.metrics import METRICS, Deformed, measure
from eval.metrics.deformation import chamfer, hausdorff
from sshade import DeformationTask, Handles, TransferTask
from tests.shapes import bumpy
from tests.sshade.proxy.test_projection import nearest_in_triangle

OF_TRUTH = {name for name, metric in METRICS.items() if "truth" in metric.needs}
OF_HANDLES = {"handle", "spike"}


def transfer_task(mesh, truth):
    return TransferTask("t", mesh, mesh, truth, truth=truth)


def brute_force(P, V, F):
    return np.array([min(nearest_in_triangle(p, V[face]) for face in F) for p in P])


def test_against_brute_force():
    mesh = bumpy(1)
    rng = np.random.default_rng(0)
    truth = 3 + 2 * mesh.V * [1, 0.8, 1.1]
    vertices = truth + rng.normal(0, 0.2, truth.shape)
    centre = truth.mean(axis=0)
    scale = np.linalg.norm(truth - centre, axis=1).max()
    a, b = (truth - centre) / scale, (vertices - centre) / scale
    there, back = brute_force(b, a, mesh.F), brute_force(a, b, mesh.F)
    task = transfer_task(mesh, truth)
    assert hausdorff(Deformed(task, vertices)) == pytest.approx(max(there.max(), back.max()), rel=1e-9)
    assert chamfer(Deformed(task, vertices)) == pytest.approx((there**2).mean() + (back**2).mean(), rel=1e-9)
    assert there.max() != back.max()


def test_a_task_gets_the_metrics_that_it_has_what_it_takes_for():
    task = ends_task(bumpy(1))
    without = set(measure(task, task.mesh.V))
    assert without == set(METRICS) - OF_TRUTH
    known = DeformationTask("t", task.mesh, Handles(np.array([0]), task.mesh.V[:1]), truth=task.mesh.V)
    # Only transfers have surface distances.
    assert set(measure(known, task.mesh.V)) == set(METRICS) - {"hausdorff", "chamfer"}
    assert set(measure(transfer_task(task.mesh, task.mesh.V), task.mesh.V)) == set(METRICS) - OF_HANDLES
    unknown = TransferTask("t", task.mesh, task.mesh, task.mesh.V)
    assert set(measure(unknown, task.mesh.V)) == without - OF_HANDLES

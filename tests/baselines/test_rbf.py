"""Radial basis functions against SciPy's own call and a dense solution of the spline's equations."""

import numpy as np
from scipy.interpolate import RBFInterpolator

from baselines.rbf import rbf
from sshade.problem.task import DeformationTask, Handles
from tests.shapes import bumpy


def task():
    mesh, rng = bumpy(2), np.random.default_rng(6)
    index = rng.choice(mesh.n, 20, replace=False)
    return DeformationTask("dense", mesh, Handles(index, mesh.V[index] + rng.normal(size=(20, 3))))


def test_the_thin_plate_spline_solves_its_equations():
    """r^2 log r with an affine map, fitted to all handles."""
    given = task()
    P, V = given.mesh.V[given.handles.index], given.mesh.V

    def kernel(A):
        squared = np.square(A[:, None] - P).sum(axis=2)
        return 0.5 * squared * np.log(np.where(squared > 0, squared, 1.0))

    affine = np.c_[np.ones(20), P]
    system = np.block([[kernel(P), affine], [affine.T, np.zeros((4, 4))]])
    weights = np.linalg.solve(system, np.concatenate([given.handles.target, np.zeros((4, 3))]))
    expected = np.c_[kernel(V), np.ones(len(V)), V] @ weights
    np.testing.assert_allclose(rbf(given, neighbours=20).vertices, expected, atol=1e-9)


def test_the_kernel_is_the_one_that_is_named():
    given = task()
    P, V = given.mesh.V[given.handles.index], given.mesh.V
    expected = RBFInterpolator(P, given.handles.target, kernel="cubic")(V)
    np.testing.assert_allclose(rbf(given, neighbours=20, kernel="cubic").vertices, expected, atol=1e-9)

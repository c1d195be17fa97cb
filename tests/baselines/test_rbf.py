"""Radial basis functions against SciPy's own call."""

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from baselines.rbf import rbf
from sshade.problem.task import DeformationTask, Handles
from tests.shapes import bumpy


@pytest.mark.parametrize("kernel", ["thin_plate_spline", "cubic"])
def test_it_is_the_spline_of_scipy_through_the_nearest_handles(kernel):
    mesh, rng = bumpy(2), np.random.default_rng(6)
    index = rng.choice(mesh.n, 20, replace=False)
    given = Handles(index, mesh.V[index] + rng.normal(size=(20, 3)))
    found = rbf(DeformationTask("dense", mesh, given), neighbours=12, kernel=kernel).vertices
    expected = RBFInterpolator(mesh.V[index], given.target, neighbors=12, kernel=kernel)(mesh.V)
    np.testing.assert_allclose(found, expected, atol=1e-9)

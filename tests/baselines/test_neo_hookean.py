"""The elastic energy, its derivatives and Newton's method on coarse tetrahedra."""

import numpy as np
import pytest
from scipy.sparse import diags_array
from scipy.spatial.transform import Rotation

from baselines.volumetric.coarse_tetrahedra import coarse_tetrahedra
from baselines.volumetric.neo_hookean import Elasticity, _simkit, lame, newton
from tests.shapes import bent, bumpy, held_ends


def elasticity():
    for name in ("pytetwild", "simkit"):
        pytest.importorskip(name, reason="the extra neo_hookean is not installed")
    mesh = bumpy(1)
    made = coarse_tetrahedra(mesh, samples=10**6, edge=0.3)
    carry = made.carry[held_ends(mesh).handles.index]
    middle, size = np.zeros(3), mesh.diagonal
    made_of = Elasticity(made, carry, _simkit(), centre=middle, scale=size, poisson=0.4, weight=1e2)
    return made_of, made.V / mesh.diagonal


def test_the_elastic_derivatives_are_those_of_the_energy():
    problem, X = elasticity()
    rng = np.random.default_rng(0)
    x, d = bent(X) + 0.005 * rng.normal(size=X.shape), rng.normal(size=X.shape)
    h = 1e-6
    slope = (problem.energy(x + h * d) - problem.energy(x - h * d)) / (2 * h)
    assert (problem.gradient(x) * d).sum() == pytest.approx(slope, rel=1e-6)
    # At rest, simkit's projection changes nothing, so the Hessian is the derivative of the gradient.
    change = (problem.gradient(X + h * d) - problem.gradient(X - h * d)) / (2 * h)
    found = (problem.hessian(X) @ d.ravel()).reshape(-1, 3)
    assert np.abs(found - change).max() < 1e-4 * np.abs(change).max()


def test_no_force_is_left_where_newton_stops():
    problem, X = elasticity()
    problem.target = problem.target @ Rotation.from_rotvec([0, 0, 0.3]).as_matrix().T * [1, 1, 1.1]
    x, moves = newton(problem, X, tolerance=1e-10, max_iterations=50)
    assert moves[-1] < 1e-10
    force = np.abs(problem.gradient(x)).max()
    assert force < 1e-6 * np.abs(problem.gradient(X)).max() and problem.energy(x) < problem.energy(X)


@pytest.mark.parametrize("poisson", [0.1, 0.3, 0.45])
def test_a_stretched_body_thins_by_poissons_ratio(poisson):
    pytest.importorskip("simkit", reason="the extra neo_hookean is not installed")
    from simkit.energies.stable_neo_hookean import (
        stable_neo_hookean_gradient_element_F,
        stable_neo_hookean_hessian_element_F,
    )

    mu, lam = (np.full((1, 1), value) for value in lame(poisson))
    H = stable_neo_hookean_hessian_element_F(np.eye(3)[None], mu, lam)[0]
    assert np.abs(stable_neo_hookean_gradient_element_F(np.eye(3)[None], mu, lam)).max() < 1e-12
    diagonal = H[np.ix_([0, 4, 8], [0, 4, 8])]
    thinner = np.linalg.solve(diagonal[1:, 1:], -diagonal[1:, 0])
    np.testing.assert_allclose(thinner, -poisson, atol=1e-9)
    shear = np.zeros(9)
    shear[[1, 3]] = 0.5
    assert shear @ H @ shear == pytest.approx(1.0)  # the shear modulus


class Valley:
    """An energy whose full Newton steps from far away lead farther away."""

    def __init__(self):
        self.reached = []

    def energy(self, x):
        return float(np.sqrt(1 + x**2).sum())

    def gradient(self, x):
        self.reached.append(self.energy(x))
        return x / np.sqrt(1 + x**2)

    def hessian(self, x):
        return diags_array((1 + x.ravel() ** 2) ** -1.5, format="csc")


def test_each_newton_step_lowers_the_energy_of_the_iterate_before():
    valley = Valley()
    x, moves = newton(valley, np.array([[30.0, -1.4, 0.5]]), tolerance=1e-8, max_iterations=40)
    assert np.abs(x).max() < 1e-8 > moves[-1]
    assert np.all(np.diff(valley.reached) < 0) and len(valley.reached) == len(moves) > 4

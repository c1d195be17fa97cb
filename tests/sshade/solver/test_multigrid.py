import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse import csr_array, diags_array

from sshade import Mesh
from sshade.core.threads import ThreadTeam
from sshade.solver import multigrid as module
from sshade.solver.laplacian import edge_weights, half_cotangents, laplacian_matrix
from sshade.solver.multigrid import Multigrid
from tests.shapes import bumpy, jittered, strip


def without_area(mesh: Mesh, faces: int) -> Mesh:
    """Return the mesh with the first corner of some faces moved onto or near (1e-7) the second corner."""
    V = mesh.V.copy()
    chosen = mesh.F[np.random.default_rng(0).choice(mesh.m, faces, replace=False)]
    V[chosen[:, 0]] = V[chosen[:, 1]] + np.where(np.arange(faces) % 2, 1e-7, 0.0)[:, None]
    return Mesh(V, mesh.F)


def every(mesh: Mesh, step: int) -> np.ndarray:
    return np.arange(mesh.n) % step == 0


BALL, SHEET = bumpy(4), jittered(strip(60, 40), 0.2)
SQUASHED = Mesh(SHEET.V * [1.0, 5.0, 1.0], SHEET.F)
#: For each case: the mesh, its fixed vertices, and the largest fraction of an error after a V-cycle.
CASES = {
    "closed, few handles": (BALL, every(BALL, 500), 0.615),
    "closed, a region": (BALL, BALL.V[:, 2] > 0.5, 0.615),
    "boundary": (SHEET, every(SHEET, 900), 0.535),
    "faces without area": (without_area(BALL, 100), every(BALL, 500), 0.6),
    "long triangles": (SQUASHED, every(SQUASHED, 900), 0.9),
}


def matrix(name: str) -> tuple[csr_array, np.ndarray]:
    mesh, held, _ = CASES[name]
    return laplacian_matrix(mesh.n, *edge_weights(mesh, half_cotangents(mesh))), held


def cycle(multigrid: Multigrid, held: np.ndarray, x: np.ndarray, *, workers: int = 1) -> np.ndarray:
    """Return M x for x (f, 3) of free rows."""
    B = np.zeros((len(held), 3))
    B[~held] = x
    with ThreadTeam(workers) as team:
        multigrid.apply(B, B, team=team)
    assert not B[held].any()
    return B[~held]


@pytest.mark.parametrize("name", CASES)
def test_a_cycle_is_linear_and_symmetric_and_leaves_a_fraction_of_an_error(name, monkeypatch):
    """Power iteration finds the largest eigenvalue of I - M A, which is symmetric in the energy norm."""
    monkeypatch.setattr(module, "COARSEST", 100)
    A, held = matrix(name)
    multigrid, A = Multigrid(A, held), A[~held][:, ~held]
    assert len(multigrid._levels) >= 2
    x, y = np.random.default_rng(0).normal(size=(2, A.shape[0], 3))
    Mx, My = cycle(multigrid, held, x), cycle(multigrid, held, y)
    assert (x * My).sum() == pytest.approx((Mx * y).sum(), abs=1e-7 * np.linalg.norm(Mx) * np.linalg.norm(y))
    both = cycle(multigrid, held, 2 * x - y)
    assert np.abs(both - (2 * Mx - My)).max() < 1e-5 * np.abs(both).max()
    assert np.array_equal(cycle(multigrid, held, 2.0**600 * x), 2.0**600 * Mx)
    for _ in range(40):
        x /= np.sqrt((x * (A @ x)).sum(axis=0))
        x -= cycle(multigrid, held, A @ x)
    left = np.sqrt((x * (A @ x)).sum(axis=0))
    assert (left > 0.1).all() and (left < CASES[name][2]).all()


@pytest.mark.parametrize(("degree", "least"), [(3, 0.4), (2, 0.35), (1, 0.2)])
@pytest.mark.parametrize("coarsest", [20, 200])
def test_the_eigenvalues_lie_between_0_and_1(coarsest, degree, least, monkeypatch):
    monkeypatch.setattr(module, "COARSEST", coarsest)
    mesh = jittered(strip(24, 18), 0.25)
    A = laplacian_matrix(mesh.n, *edge_weights(mesh, half_cotangents(mesh)))
    held = every(mesh, 100)
    multigrid, free = Multigrid(A, held, degree=degree), int((~held).sum())
    unit = np.eye(free, free + 2)
    M = np.hstack([cycle(multigrid, held, unit[:, c : c + 3]) for c in range(0, free, 3)])[:, :free]
    values = eigh(M, np.linalg.inv(A[~held][:, ~held].toarray()), eigvals_only=True)
    assert values[0] > least and values[-1] <= 1 + 1e-6


def test_what_is_small_or_does_not_coarsen_is_factorised(monkeypatch):
    A, held = matrix("closed, few handles")
    x = np.random.default_rng(0).normal(size=((~held).sum(), 3))
    apart = csr_array(diags_array(np.linspace(1.0, 2.0, len(held))))
    for Q, coarsest in ((A, len(held)), (apart, 10)):
        monkeypatch.setattr(module, "COARSEST", coarsest)
        multigrid = Multigrid(Q, held)
        assert multigrid.finest is None
        assert np.abs(Q[~held][:, ~held] @ cycle(multigrid, held, x) - x).max() < 1e-11


def test_not_positive_definite():
    A, held = matrix("closed, few handles")
    with pytest.raises(FloatingPointError, match="not positive"):
        Multigrid(csr_array(-A), held)
    with pytest.raises(FloatingPointError, match="not finite"):
        Multigrid(csr_array(np.nan * A), held)

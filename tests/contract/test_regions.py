"""Every method of conf/method takes handles that are regions, of any size and shape."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eval.metrics.deformation import edge
from eval.metrics.deformed import Deformed
from sshade import DeformationTask, Handles, Mesh
from sshade.solver.local_global import local_global
from tests.full import few
from tests.methods import LEARNED, configured, methods
from tests.shapes import block, bumpy, jittered

METHODS = [name for name in methods("", "peer") if name != "identity"]

#: Handles as soft as the methods' own weight has them: mean distance over the diagonal.
SOFT = {"peer/slim": 1e-2, "peer/neo_hookean": 2e-2}
NEAR = 5e-2
#: Linear fields move with their handles but do not turn with them: faces between two regions may flip.
LINEAR = {"peer/harmonic", "peer/biharmonic", "peer/rbf"}
#: Edges change at most by so much more than with ARAP: those of a coarse proxy beside a region that moves.
MORE = 3.0


def parts(mesh: Mesh, *moves: tuple[np.ndarray, np.ndarray]) -> DeformationTask:
    """Each part (n,) bool of the mesh goes to its place among (n, 3) positions."""
    index = [np.flatnonzero(part) for part, _ in moves]
    target = np.concatenate([V[own] for own, (_, V) in zip(index, moves, strict=True)])
    return DeformationTask("regions", mesh, Handles(np.concatenate(index), target))


def turned(V: np.ndarray, degrees: float, shift: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    return V @ Rotation.from_euler("z", degrees, degrees=True).as_matrix().T + shift


def bar() -> Mesh:
    """A box of 1 x 1 x 6, closed."""
    return jittered(block(np.ones((1, 1, 6)), cells=8), 0.01)


@cache
def task(name: str) -> DeformationTask:
    mesh = bar() if name == "ring" else bumpy(4)
    V = mesh.V
    low, middle, high = np.quantile(V[:, 2], [1 / 3, 1 / 2, 0.95])
    held = V[:, 2] < low
    if name == "a third held, a twentieth moved":
        return parts(mesh, (held, V), (V[:, 2] > high, turned(V, 20, (0.2, 0.1, 0.2))))
    if name == "regions that touch":
        beside = (V[:, 2] >= low) & (V[:, 2] < middle)
        return parts(mesh, (held, V), (beside, turned(V, 5)), (V[:, 2] > high, turned(V, 20)))
    if name == "ring":
        ring = (V[:, 2] > 3.0) & (V[:, 2] < 3.5)
        about = V - [0.5, 0.5, 0]
        return parts(mesh, (V[:, 2] < 1, V), (ring, turned(about, 40) + [0.5, 0.5, 0]))
    if name == "a component":
        both = Mesh(np.concatenate([V, V + [6, 0, 0]]), np.concatenate([mesh.F, mesh.F + mesh.n]))
        first = np.arange(both.n) < mesh.n
        of_first = first & (both.V[:, 2] < low), first & (both.V[:, 2] > high)
        moves = (
            (of_first[0], both.V),
            (of_first[1], turned(both.V, 20)),
            (~first, turned(both.V, 0, (0, 0, 9))),
        )
        return parts(both, *moves)
    assert name == "nothing free"
    return parts(mesh, (np.ones(mesh.n, dtype=bool), turned(V * [1.0, 1.1, 1.2], 30)))


CASES = (
    "a third held, a twentieth moved",
    "regions that touch",
    "ring",
    "a component",
    "nothing free",
)


@pytest.fixture(scope="module", params=METHODS)
def method(request):
    call = configured(request.param, "proxy.vertices=600", "solver.max_iterations=150")
    return SimpleNamespace(name=request.param, call=call)


@cache
def arap(name: str) -> Deformed:
    case = task(name)
    return Deformed(case, local_global(case, energy="spokes", start="rigid").vertices)


@pytest.mark.parametrize("name", few(CASES, "a third held, a twentieth moved", "ring", "nothing free"))
def test_regions_are_taken(method, name):
    case = task(name)
    before = [array.copy() for array in (case.mesh.V, case.handles.index, case.handles.target)]
    try:
        V = method.call(case, seed=1).vertices
    except ImportError as error:
        pytest.skip(str(error))
    assert V.shape == case.mesh.V.shape and np.isfinite(V).all()
    for array, copy in zip((case.mesh.V, case.handles.index, case.handles.target), before, strict=True):
        np.testing.assert_array_equal(array, copy)
    gap = np.linalg.norm(V[case.handles.index] - case.handles.target, axis=1) / case.mesh.diagonal
    if method.name in LEARNED:
        assert np.median(gap) < NEAR or name == "a component"  # few steps of training move none so far
        return
    if method.name in SOFT:
        assert gap.mean() < SOFT[method.name]
        return
    assert gap.max() <= 1e-12
    if method.name in LINEAR:
        return
    deformed, reference = Deformed(case, V), arap(name)
    assert not (deformed.flipped & ~reference.flipped).any()
    assert edge(deformed) <= MORE * edge(reference) + 1e-9

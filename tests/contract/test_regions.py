"""Every method of conf/method and its folder peer accepts handle regions of any size and shape."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.accelerated import local_global
from eval.metrics.deformation import edge
from eval.metrics.deformed import Deformed
from sshade import DeformationTask, Mesh
from tests.methods import LEARNED, configured, methods
from tests.shapes import block, bumpy, jittered, moved_parts

METHODS = [name for name in methods("", "peer") if name != "identity"]

#: Methods whose handles are soft by default: maximum mean distance of handles from their targets, as a
#: fraction of the diagonal.
SOFT = {"peer/slim": 1e-2, "peer/neo_hookean": 2e-2}
NEAR = 5e-2
#: Linear fields move with their handles but do not turn with them: faces between two regions may flip.
LINEAR = {"peer/harmonic", "peer/biharmonic", "peer/rbf"}
#: Maximum edge change, as a multiple of ARAP's edge change. A method with a coarse proxy changes edges more
#: beside a region that moves.
MORE = 3.0


def turned(degrees: float, *, shift=(0.0, 0.0, 0.0), centre=(0.0, 0.0, 0.0)):
    """Return a map that turns positions about the axis along z through `centre` and then shifts them."""
    turn = Rotation.from_euler("z", degrees, degrees=True)
    return lambda V: turn.apply(V - centre) + centre + shift


def cases() -> dict[str, tuple[Mesh, list[tuple]]]:
    """Return meshes, each with the parts that are fixed or moved."""
    body, bar = bumpy(4), jittered(block(np.ones((1, 1, 6)), cells=8), 0.01)
    z = body.V[:, 2]
    low, high = np.quantile(z, [1 / 3, 0.95])
    ring = (bar.V[:, 2] > 3.0) & (bar.V[:, 2] < 3.5)
    return {
        "a third held": (body, [(z < low, 0), (z > high, turned(20, shift=(0.2, 0.1, 0.2)))]),
        "ring": (bar, [(bar.V[:, 2] < 1, 0), (ring, turned(40, centre=(0.5, 0.5, 0)))]),
        "nothing free": (body, [(slice(None), lambda V: turned(30)(V * [1.0, 1.1, 1.2]))]),
    }


CASES = {
    name: DeformationTask(name, mesh, moved_parts(mesh.V, *parts, group=None))
    for name, (mesh, parts) in cases().items()
}


@pytest.fixture(scope="module", params=METHODS)
def method(request):
    call = configured(request.param, "proxy.vertices=600", "solver.max_iterations=150")
    return SimpleNamespace(name=request.param, call=call)


@cache
def arap(name: str) -> Deformed:
    case = CASES[name]
    return Deformed(case, local_global(case, energy="spokes", start="rigid").vertices)


@pytest.mark.parametrize("name", CASES)
def test_regions_are_taken(method, name):
    case = CASES[name]
    try:
        V = method.call(case, seed=1).vertices
    except ImportError as error:
        pytest.skip(str(error))
    assert V.shape == case.mesh.V.shape and np.isfinite(V).all()
    gap = np.linalg.norm(V[case.handles.index] - case.handles.target, axis=1) / case.mesh.diagonal
    if method.name in LEARNED:
        assert np.median(gap) < NEAR
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

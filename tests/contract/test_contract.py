"""Promises of the methods of conf/method and its folders, whoever wrote them: motions, seeds, and regions."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.accelerated import local_global
from eval.metrics.deformation import edge
from eval.metrics.deformed import Deformed
from sshade import DeformationTask, Handles, Mesh, TransferTask
from tests.eval.eval_cases import bumpy_task
from tests.methods import LEARNED, configured, methods
from tests.shapes import block, bumpy, jittered, moved_parts

METHODS = methods("", "peer", "transfer")

#: Maximum error of a position, as a fraction of the bounding-box diagonal.
CLOSE = 1e-6

#: libigl fits rotations in float32: targets at rest already move vertices by 1.2e-5 of this mesh's diagonal.
CLOSE_LIBIGL = 5e-5

#: A learned method is less exact, because its handles are soft and it takes few steps here.
CLOSE_LEARNED = 2e-2

#: Maximum errors of methods whose result depends on how the mesh lies in the axes.
#: SShaDe's frames follow a coordinate of the mesh. With this coarse proxy, four random turns change its
#: result by 0.7e-3 to 1.5e-3. The samples and features of a learned method lie along the axes. After its few
#: steps, turns change its result by 3e-2 to 4e-2.
AXIS_DEPENDENT = {"paper": 3e-3, "paper_plain": 3e-3, "peer/lattice_arap": 1e-2}
AXIS_DEPENDENT |= dict.fromkeys(LEARNED, 6e-2)

#: Maximum errors of methods on tetrahedra. fTetWild fills a turned mesh with other tetrahedra; even a second
#: run on the same mesh would give other tetrahedra. The values are three times the errors that were measured
#: with tetrahedra as coarse as here.
OTHER_TETRAHEDRA = {f"peer/{name}": 1e-2 for name in ("tetrahedral_arap", "slim", "neo_hookean")}
OTHER_TETRAHEDRA |= {"peer/bbw": 4e-3, "peer/biharmonic_coordinates": 4e-2}

#: Maximum error of a transfer. If a vertex is equally near to two triangles of the proxy, rounding decides
#: which triangle the vertex follows.
TRANSFER = 3e-3

#: Two rotations that map axes to axes without rounding, and a general rotation.
TURNS = {
    "no turn": np.eye(3),
    "quarter turn about x": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "any turn": Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix(),
}


@pytest.fixture(scope="module", params=METHODS)
def method(request):
    """A method with a small proxy and a fixed number of iterations."""
    fixed = ("solver.tolerance=0", "solver.max_iterations=40")
    call = configured(request.param, "proxy.vertices=200", *fixed)
    transfers = request.param.startswith("transfer/")
    task = transfer_task() if transfers else bumpy_task()
    try:
        result = call(task, seed=3)
    except ImportError as error:
        pytest.skip(str(error))
    return SimpleNamespace(name=request.param, call=call, task=task, transfers=transfers, result=result)


def transfer_task() -> TransferTask:
    rest = bumpy(3)
    x, y, z = rest.V.T
    edited = Mesh(rest.V * (1 + 0.2 * np.maximum(0, x) ** 3)[:, None], rest.F)
    return TransferTask("t", edited, rest, np.stack([x + 0.1 * z**2, y, z], axis=1))


def moved(task, R: np.ndarray, shift: np.ndarray, factor: float = 1.0):
    """Return a task whose positions are all turned, scaled and shifted."""

    def place(V: np.ndarray) -> np.ndarray:
        return factor * (V @ R.T) + shift

    mesh = Mesh(place(task.mesh.V), task.mesh.F)
    if isinstance(task, TransferTask):
        return TransferTask("moved", mesh, Mesh(place(task.rest.V), task.rest.F), place(task.posed))
    own = task.handles
    handles = Handles(own.index, place(own.target), dynamic=own.dynamic, group=own.group)
    return DeformationTask("moved", mesh, handles)


def arrays(task) -> list[np.ndarray]:
    if isinstance(task, TransferTask):
        return [task.mesh.V, task.rest.V, task.posed]
    return [task.mesh.V, task.mesh.F, task.handles.index, task.handles.target, task.handles.dynamic]


def close(method) -> float:
    """Return the tolerance of a method, as a fraction of the diagonal."""
    if method.transfers:
        return 1e-12
    if method.name in LEARNED:
        return CLOSE_LEARNED
    return CLOSE_LIBIGL if method.name in ("arap", "elastic") else CLOSE


def test_a_seed_gives_the_same_bits_again_and_the_input_is_untouched(method):
    before = [array.copy() for array in arrays(method.task)]
    np.testing.assert_array_equal(method.call(method.task, seed=3).vertices, method.result.vertices)
    for array, copy in zip(arrays(method.task), before, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_targets_at_rest_give_the_rest_shape_and_rigid_poses_move_the_edited_one(method):
    task, mesh = method.task, method.task.mesh
    cases = [(np.eye(3), np.zeros(3))]
    if method.transfers:
        cases.append((Rotation.from_rotvec([0.3, -0.5, 2.0]).as_matrix(), np.array([1.0, -2, 3])))
    for R, shift in cases:
        if method.transfers:
            at_rest = TransferTask("rigid", mesh, task.rest, task.rest.V @ R.T + shift)
        else:
            held = task.handles.index
            at_rest = DeformationTask("at rest", mesh, Handles(held, mesh.V[held]))
        gap = np.abs(method.call(at_rest, seed=3).vertices - (mesh.V @ R.T + shift)).max()
        assert gap <= close(method) * mesh.diagonal


@pytest.mark.parametrize("turn", TURNS)
def test_moving_everything_together_moves_the_result(method, turn):
    R, shift = TURNS[turn], np.array([0.75, -1.25, 0.5])
    result = method.call(moved(method.task, R, shift), seed=3).vertices
    gap = np.abs(result - (method.result.vertices @ R.T + shift)) / method.task.mesh.diagonal
    if method.transfers:
        assert np.median(gap) <= (0.1 * TRANSFER if turn != "no turn" else close(method))
        assert gap.max() <= TRANSFER
    else:
        most = {"no turn": {}, "any turn": OTHER_TETRAHEDRA | AXIS_DEPENDENT}.get(turn, OTHER_TETRAHEDRA)
        assert gap.max() <= most.get(method.name, close(method))


def test_scaling_everything_together_scales_the_result(method):
    scaled = moved(method.task, np.eye(3), np.zeros(3), 64.0)
    result = method.call(scaled, seed=3)
    gap = np.abs(result.vertices - 64 * method.result.vertices).max()
    assert gap <= close(method) * scaled.mesh.diagonal
    facts = {k: v for k, v in method.result.extra.items() if isinstance(v, float) and k != "energy"}
    assert {name: result.extra[name] for name in facts} == pytest.approx(facts, rel=0.01, abs=1e-6)


DEFORMING = [name for name in methods("", "peer") if name != "identity"]

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
    body, bar = bumpy(3), jittered(block(np.ones((1, 1, 6)), cells=5), 0.01)
    z = body.V[:, 2]
    low, high = np.quantile(z, [1 / 3, 0.95])
    ring = (bar.V[:, 2] > 3.0) & (bar.V[:, 2] < 3.5)
    return {
        "a third held": (body, [(z < low, 0), (z > high, turned(20, shift=(0.2, 0.1, 0.2)))]),
        "ring": (bar, [(bar.V[:, 2] < 1, 0), (ring, turned(40, centre=(0.5, 0.5, 0)))]),
        "nothing free": (body, [(slice(None), lambda V: turned(30)(V * [1.0, 1.1, 1.2]))]),
    }


HANDLES = {name: (mesh, moved_parts(mesh.V, *parts, group=None)) for name, (mesh, parts) in cases().items()}
CASES = {name: DeformationTask(name, *given) for name, given in HANDLES.items()}


@pytest.fixture(scope="module", params=DEFORMING)
def deforming(request):
    call = configured(request.param, "proxy.vertices=300", "solver.max_iterations=100")
    return SimpleNamespace(name=request.param, call=call)


@cache
def arap(name: str) -> Deformed:
    case = CASES[name]
    return Deformed(case, local_global(case, energy="spokes", start="rigid").vertices)


@pytest.mark.parametrize("name", CASES)
def test_regions_are_taken(deforming, name):
    case = CASES[name]
    try:
        V = deforming.call(case, seed=1).vertices
    except ImportError as error:
        pytest.skip(str(error))
    assert V.shape == case.mesh.V.shape and np.isfinite(V).all()
    gap = np.linalg.norm(V[case.handles.index] - case.handles.target, axis=1) / case.mesh.diagonal
    if deforming.name in LEARNED:
        assert np.median(gap) < NEAR
        return
    if deforming.name in SOFT:
        assert gap.mean() < SOFT[deforming.name]
        return
    assert gap.max() <= 1e-12
    if deforming.name in LINEAR:
        return
    deformed, reference = Deformed(case, V), arap(name)
    assert not (deformed.flipped & ~reference.flipped).any()
    assert edge(deformed) <= MORE * edge(reference) + 1e-9

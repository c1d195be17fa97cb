"""What paper, fast and fine promise: samplings, goals for the volume, proxies, and the polish."""

import weakref
from threading import Barrier

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sshade
from baselines.accelerated import local_global
from sshade import DeformationTask, Deformer, Handles, Mesh, bind, transfer_pose
from sshade.method import polish
from sshade.problem.options import PRESETS, SOLVER
from sshade.proxy.triangle import TriangleFrames
from sshade.regions.handle_regions import edge_vertices
from tests.shapes import bent, beside, bumpy, end_handles, moved_parts, shifted
from tests.sshade.method.calls import fast, fine, paper

POLISH = {name: getattr(PRESETS["fine"], name) for name in SOLVER}


@pytest.fixture(scope="module")
def task() -> DeformationTask:
    """A bumpy ball with its cap pushed aside."""
    mesh = bumpy(4)
    return DeformationTask("cap", mesh, end_handles(mesh.V, share=0.075, shift=(0.5, 0.1, 0.2)))


@pytest.mark.parametrize(("method", "area"), [(fast, 8e-3), (fine, 1e-6)])
def test_volume_area_and_handles_are_kept(task, method, area):
    """`fast` constrains the area of the proxy only, so the area of the mesh is less exact."""
    result = method(task, vertices=600, area=np.inf)
    after, facts = Mesh(result.vertices, task.mesh.F), result.facts
    assert after.volume == pytest.approx(task.mesh.volume, rel=1e-6)
    assert after.area == pytest.approx(task.mesh.area, rel=area)
    gap = np.abs(result.vertices[task.handles.index] - task.handles.target).max()
    assert gap < 1e-12 * task.mesh.diagonal if method is fast else gap == 0
    assert facts.volume_constraint == facts.area_constraint == "exact"
    assert facts.volume_error < 1e-6 and facts.area_error < 1e-6
    assert method is fast or facts.proxy_iterations > 0 and result.iterations <= 60


@pytest.mark.parametrize("volume", [0.0, np.inf])
def test_fine_ends_in_the_minimum_at_full_resolution(task, volume):
    """A converged polish ends in the minimum that the solver finds from the rest shape.

    `fine` turns the surface beside regions after the polish. Here only the edges of regions are handles.
    """
    edge = np.isin(task.handles.index, edge_vertices(task.mesh, task.handles.index))
    handles = Handles(task.handles.index[edge], task.handles.target[edge])
    task = DeformationTask("edges", task.mesh, handles)
    options = {"volume": volume, "area": 0.0, "tolerance": 1e-7}
    result = fine(task, vertices=600, polish_iterations=3000, joints=0, **options)
    plain = local_global(task, **{**POLISH, **options, "max_iterations": 5000})
    assert result.converged and plain.converged
    assert result.facts.energy == pytest.approx(plain.extra["energy"], rel=1e-5)
    assert np.abs(result.vertices - plain.vertices).max() < 1e-3 * task.mesh.diagonal


def test_a_polish_frees_the_result_of_the_proxy(task, monkeypatch):
    def solved(*given, start, **options):
        rest, last = start.copy(), weakref.ref(start)
        del start
        left.append(last())
        return solve(*given, start=rest, **options)

    left, solve = [], polish.solve
    monkeypatch.setattr(polish, "solve", solved)
    fine(task, vertices=100, polish_iterations=1)
    assert left[0] is None


def ends(mesh: Mesh) -> DeformationTask:
    """Twelve vertices at each end along the longest axis as handles, one end turned and shifted."""
    x = mesh.V[:, np.argmax(np.ptp(mesh.V, axis=0))]
    ends = x < x.min() + 0.08 * np.ptp(x), x > x.max() - 0.08 * np.ptp(x)
    low, high = (np.flatnonzero(end)[:12] for end in ends)
    turn, centre = Rotation.from_euler("z", -32, degrees=True), mesh.V[high].mean(axis=0)
    turned = high, lambda V: turn.apply(V - centre) + centre + 0.1 * mesh.diagonal
    own = moved_parts(mesh.V, (low, 0), turned, dynamic=np.repeat([False, True], 12))
    return DeformationTask("ends", mesh, own)


@pytest.fixture(scope="module")
def body_task() -> DeformationTask:
    return ends(bumpy(3))


@pytest.mark.parametrize("frames", ["triangle", "blended"])
def test_the_result_is_the_mean_of_the_single_samplings(body_task, frames):
    single = []
    for i in range(3):
        binding = bind(body_task.mesh, 70, first=body_task.handles.index, seed=(9, i), frames=frames)
        own = body_task.handles
        handles = Handles(np.arange(len(own)), own.target, dynamic=own.dynamic, group=own.group)
        solved = local_global(DeformationTask("one", binding.proxy, handles), start="rigid")
        V, _ = binding.carry(solved.vertices, rotations=solved.extra["rotations"])
        single.append((V, solved, binding))
    result = paper(body_task, vertices=70, samplings=3, frames=frames, seed=9)
    first, second, third = (V for V, _, _ in single)
    assert np.array_equal(result.vertices, ((first + second) + third) / 3)
    assert np.abs(first - second).max() > 1e-3
    assert result.iterations == np.mean([solved.iterations for _, solved, _ in single])
    assert result.converged == all(solved.converged for _, solved, _ in single)
    assert result.facts.samplings == 3
    assert result.facts.proxy_vertices == np.mean([b.proxy.n for _, _, b in single])
    assert result.facts.added_samples == sum(b.sampling.added for _, _, b in single)
    assert result.facts.residual == max(solved.extra["residual"] for _, solved, _ in single)
    assert result.facts.energy == np.mean([solved.extra["energy"] for _, solved, _ in single])
    assert set(result.seconds) == {"remesh", "bind", "solve", "carry"}


BODY = bumpy(3)
#: Largest relative error of a volume.
WHOLE = 1e-3


def task_of(mesh: Mesh, *, count: int = 12) -> DeformationTask:
    """Return a task with handles at both ends along z; the upper end is moved."""
    return DeformationTask("t", mesh, end_handles(mesh.V, count=count, shift=[0.3, 0, 0.3]))


def ratio(mesh: Mesh, V: np.ndarray) -> float:
    return Mesh(V, mesh.F).volume / mesh.volume


MESHES = {"closed": BODY, "two": beside(BODY, shifted(BODY, [6.0, 0, 0])), "regions": BODY}


@pytest.mark.parametrize("method", ["fast", "fine", "paper"])
@pytest.mark.parametrize("name", MESHES)
def test_goals_are_reached_with_handles_on_their_targets(name, method):
    mesh, count = MESHES[name], {"regions": 150, "two": 40}.get(name, 12)
    options = {"volume": np.inf} if method == "paper" else {}
    result = sshade.deform(task_of(mesh, count=count), method=method, volume_goal=1.1, **options)
    assert ratio(mesh, result.vertices) == pytest.approx(1.1, rel=WHOLE)
    assert ratio(BODY, result.vertices[: BODY.n]) == pytest.approx(1.1, rel=WHOLE)  # of each component
    assert method == "paper" or result.facts.hard_handle_error < 1e-12
    assert result.facts.volume_goal_error < WHOLE and result.facts.options["volume_goal"] == 1.1


@pytest.mark.parametrize("run", [paper, Deformer, transfer_pose])
def test_samplings_go_side_by_side(body, run):
    """Each waits for the other."""
    together, places = Barrier(2, timeout=60), []
    task = DeformationTask("t", body, end_handles(body.V, count=5))

    def frames(proxy, _):
        places.append(together.wait())
        return TriangleFrames.at_rest(proxy)

    given = {paper: (task,), Deformer: (body, task.handles.index), transfer_pose: (body, bent(body.V))}[run]
    run(*given, vertices=60, samplings=2, workers=2, frames=frames)
    assert sorted(places) == [0, 1]

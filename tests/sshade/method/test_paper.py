"""The paper's method from end to end."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.accelerated import local_global
from sshade import DeformationResult, DeformationTask, Handles, Mesh, bind
from sshade.core.progress import silent
from tests.shapes import bent, bumpy, moved_parts
from tests.sshade.method.calls import paper


def ends(mesh: Mesh) -> DeformationTask:
    """Twelve vertices at each end along the longest axis as handles, one end turned and shifted."""
    x = mesh.V[:, np.argmax(np.ptp(mesh.V, axis=0))]
    ends = x < x.min() + 0.08 * np.ptp(x), x > x.max() - 0.08 * np.ptp(x)
    low, high = (np.flatnonzero(end)[:12] for end in ends)
    turn, centre = Rotation.from_euler("z", -32, degrees=True), mesh.V[high].mean(axis=0)
    turned = high, lambda V: turn.apply(V - centre) + centre + 0.1 * mesh.diagonal
    own = moved_parts(mesh.V, (low, 0), turned, dynamic=np.repeat([False, True], 12))
    return DeformationTask("ends", mesh, own)


def bending(task, *, seed, progress=silent) -> DeformationResult:
    """A coarse method without a solver."""
    V = bent(task.mesh.V, 0.1)
    V[task.handles.index] = task.handles.target
    return DeformationResult(V, iterations=3, converged=None)


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


def test_convergence_is_unknown_if_one_sampling_does_not_say(body_task):
    def unsure(task, *, seed, progress=silent):
        return DeformationResult(task.mesh.V, iterations=1, converged=next(answers))

    for given, whole in (([True, None], None), ([True, False], False), ([True, True], True)):
        answers = iter(given)
        assert paper(body_task, vertices=60, samplings=2, proxy_method=unsure, workers=1).converged is whole


def test_a_coarse_method_gets_the_seed_and_the_handles(body_task):
    seen = []

    def solver(task, *, seed, progress=silent) -> DeformationResult:
        seen.append(seed)
        for name in ("target", "dynamic", "group"):
            assert np.array_equal(getattr(task.handles, name), getattr(body_task.handles, name))
        return bending(task, seed=seed)

    paper(body_task, vertices=70, samplings=2, proxy_method=solver, seed=2)
    assert seen == [2, 2]

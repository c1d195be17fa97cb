from __future__ import annotations

import numpy as np
import pytest

from baselines.arap import libigl_arap
from sshade import DeformationResult, DeformationTask, Handles, InputError, Mesh, bind, deform
from sshade.carry.projection import sent_far
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.rigid import rigid_motion
from sshade.pipeline.deform import proxy_handles
from sshade.sampling.remesh import Remesh, proxy_mesh, remesh
from sshade.solver.start import initial_guess
from sshade.task import silent
from tests.shapes import bent, bumpy, family, folded, rotation, strip

#: Positions agree to rounding: this times the bounding-box diagonal.
ROUNDING = 1e-12

MESHES = family()


def ends(mesh: Mesh, *, moved: bool = True) -> DeformationTask:
    """Both ends along the longest axis as handles, one turned and shifted."""
    axis = int(np.argmax(np.ptp(mesh.V, axis=0)))
    x = mesh.V[:, axis]
    low = np.flatnonzero(x < x.min() + 0.08 * np.ptp(x))[:12]
    high = np.flatnonzero(x > x.max() - 0.08 * np.ptp(x))[:12]
    index = np.concatenate([low, high])
    dynamic = np.repeat([False, True], [len(low), len(high)])
    target = mesh.V[index].copy()
    if moved:
        centre = target[dynamic].mean(axis=0)
        turn = np.linalg.matrix_power(np.array([[0.96, 0.28, 0], [-0.28, 0.96, 0], [0, 0, 1]]), 2)
        target[dynamic] = (target[dynamic] - centre) @ turn.T + centre + 0.1 * mesh.diagonal
    return DeformationTask("ends", mesh, Handles(index, target, dynamic=dynamic, group=dynamic.astype(int)))


def bending(task, *, seed, progress=silent) -> DeformationResult:
    """A coarse method without a solver."""
    V = bent(task.mesh.V, 0.1)
    V[task.handles.index] = task.handles.target
    return DeformationResult(V, iterations=3, converged=None)


@pytest.fixture(scope="module")
def body_task() -> DeformationTask:
    return ends(bumpy(3))


def test_the_result_counts_vertices_that_were_sent_far():
    task = ends(folded())
    n, options = task.mesh.n, {"vertices": 120, "samplings": 2, "coarse": bending}
    assert deform(task, **options).extra["far_vertices"] == 0
    extra = deform(task, **options, projection="surface").extra
    counts = []
    for number in range(2):
        binding = bind(task.mesh, 120, first=task.handles.index, seed=(0, number), projection="surface")
        region, radius = binding.remesh.region, binding.remesh.distance.max()
        counts.append(sent_far(binding.projection, binding.proxy, region=region, radius=radius).sum())
    assert min(counts) > 0 and counts[0] != counts[1]
    assert (extra["far_vertices"], extra["far_share"]) == (np.mean(counts), 100 * np.mean(counts) / n)


def test_nothing_given_is_changed(body_task):
    given = [body_task.mesh.V, body_task.mesh.F, *vars(body_task.handles).values()]
    given = [array for array in given if isinstance(array, np.ndarray)]
    before = [array.copy() for array in given]
    binding = bind(body_task.mesh, 60, first=body_task.handles.index)
    NV = bent(binding.proxy.V)
    kept = NV.copy()
    binding.carry(NV)
    deform(body_task, vertices=60, samplings=2)
    assert np.array_equal(NV, kept)
    assert len(given) == 7 and all(np.array_equal(a, b) for a, b in zip(before, given, strict=True))


@pytest.mark.parametrize("coarse", [None, libigl_arap, bending])
def test_the_number_of_workers_changes_no_bit(body_task, coarse):
    a, b = (
        deform(body_task, vertices=70, samplings=3, coarse=coarse, workers=workers, seed=5)
        for workers in (1, 2)
    )
    assert np.array_equal(a.vertices, b.vertices)
    assert a.iterations == b.iterations and a.converged == b.converged
    assert {k: v for k, v in a.extra.items() if v == v} == {k: v for k, v in b.extra.items() if v == v}


def test_the_result_is_the_mean_of_the_single_samplings(body_task):
    single = []
    for i in range(3):
        binding = bind(body_task.mesh, 70, first=body_task.handles.index, seed=(9, i))
        handles = proxy_handles(body_task.handles, body_task.mesh, binding.remesh)
        solved = libigl_arap(DeformationTask("one", binding.proxy, handles))
        single.append((binding.carry(solved.vertices)[0], solved, binding))
    result = deform(body_task, vertices=70, samplings=3, coarse=libigl_arap, seed=9)
    assert np.abs(result.vertices - np.mean([V for V, _, _ in single], axis=0)).max() <= (
        ROUNDING * body_task.mesh.diagonal
    )
    assert np.abs(single[0][0] - single[1][0]).max() > 1e-3
    assert result.iterations == np.mean([solved.iterations for _, solved, _ in single])
    assert result.converged == all(solved.converged for _, solved, _ in single)
    assert result.extra["samplings"] == 3
    assert result.extra["proxy_vertices"] == np.mean([b.proxy.n for _, _, b in single])
    assert result.extra["added_samples"] == sum(b.remesh.added for _, _, b in single)
    assert result.extra["residual"] == max(solved.extra["residual"] for _, solved, _ in single)
    assert set(result.seconds) == {"remesh", "bind", "solve", "carry", "average"}


def test_seeds_choose_the_samplings(body_task):
    a, b, c = (deform(body_task, vertices=70, samplings=1, coarse=bending, seed=s) for s in (1, 1, 2))
    assert np.array_equal(a.vertices, b.vertices) and not np.array_equal(a.vertices, c.vertices)


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("mode", ["samples", "nearest"])
def test_identity_targets_leave_the_mesh(name, mode):
    mesh = MESHES[name]
    result = deform(ends(mesh, moved=False), vertices=mesh.n // 5, samplings=2, handle_mode=mode)
    assert np.abs(result.vertices - mesh.V).max() <= 1e-6 * mesh.diagonal
    assert result.converged


@pytest.mark.parametrize("mode", ["samples", "nearest"])
def test_rigidly_moved_handles_move_the_mesh_rigidly(mode):
    mesh, turn, shift = MESHES["bumpy"], rotation(3), np.array([1.0, 2, 3])
    index = np.arange(0, mesh.n, 40)
    task = DeformationTask("rigid", mesh, Handles(index, mesh.V[index] @ turn.T + shift))
    result = deform(
        task,
        vertices=100,
        samplings=2,
        handle_mode=mode,
        coarse=lambda t, **k: libigl_arap(t, start="rigid", **k),
    )
    assert np.abs(result.vertices - (mesh.V @ turn.T + shift)).max() <= 1e-5 * mesh.diagonal


@pytest.mark.parametrize("name", MESHES)
def test_handles_come_near_their_targets_and_static_ones_stay(name):
    task = ends(MESHES[name])
    result = deform(task, vertices=MESHES[name].n // 4, samplings=2)
    gap = np.linalg.norm(result.vertices[task.handles.index] - task.handles.target, axis=1)
    assert gap.max() <= 0.02 * task.mesh.diagonal
    assert result.extra["degenerate_frames"] == 0


def test_the_coarse_method_gets_the_proxy_as_a_task(body_task):
    seen = []

    def spy(task, *, seed, progress=silent):
        seen.append((task, seed))
        progress("inner", 1, 2, "note")
        return bending(task, seed=seed)

    reported = []
    progress = lambda *args: reported.append(args)  # noqa: E731
    deform(body_task, vertices=70, samplings=2, coarse=spy, seed=11, workers=1, progress=progress)
    handles = body_task.handles
    for number, (task, seed) in enumerate(seen):
        expected = bind(body_task.mesh, 70, first=handles.index, seed=(11, number)).proxy
        assert isinstance(task, DeformationTask) and seed == 11
        assert np.array_equal(task.mesh.V, expected.V) and np.array_equal(task.mesh.F, expected.F)
        assert np.array_equal(task.handles.index, np.arange(len(handles)))
        assert np.array_equal(task.mesh.V[: len(handles)], body_task.mesh.V[handles.index])
        for name in ("target", "dynamic", "group"):
            assert np.array_equal(getattr(task.handles, name), getattr(handles, name))
    assert len(seen) == 2
    assert reported == [("sampling 1", 1, 2, "note"), ("sampling 2", 1, 2, "note")]


def test_convergence_is_unknown_if_one_sampling_does_not_say(body_task):
    answers = iter([True, None, True])

    def unsure(task, *, seed, progress=silent):
        return DeformationResult(task.mesh.V, iterations=1, converged=next(answers))

    assert deform(body_task, vertices=60, samplings=3, coarse=unsure, workers=1).converged is None
    answers = iter([True, False])
    assert deform(body_task, vertices=60, samplings=2, coarse=unsure, workers=1).converged is False
    answers = iter([True, True])
    assert deform(body_task, vertices=60, samplings=2, coarse=unsure, workers=1).converged is True


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_of_the_coarse_method_is_passed_on(body_task, workers):
    def failing(task, *, seed, progress=silent):
        raise ArithmeticError("no solution")

    with pytest.raises(ArithmeticError, match="no solution"):
        deform(body_task, vertices=60, samplings=3, coarse=failing, workers=workers)


def regions(mesh: Mesh, samples: list[int], region: list[int]) -> Remesh:
    nothing = np.zeros((0, 3), dtype=np.int64)
    return Remesh(np.array(samples), nothing, np.array(region, dtype=np.int32), np.zeros(mesh.n))


def test_nearest_mode_gives_handles_to_the_sample_of_their_region():
    mesh = strip(3, 1)  # vertices 2i and 2i + 1 at x = i
    remeshed = regions(mesh, [0, 4, 7], [0, 0, 0, 1, 1, 1, 2, 2])
    handles = Handles([3, 2, 6], mesh.V[[3, 2, 6]] + [0, 0, 1], dynamic=[True, False, True], group=[5, 6, 5])
    on_proxy = proxy_handles(handles, mesh, remeshed, mode="nearest")
    assert on_proxy.index.tolist() == [0, 1, 2]
    # The static one stays at the sample's place, the dynamic ones take their shift there.
    assert np.allclose(on_proxy.target, mesh.V[[0, 4, 7]] + [[0, 0, 0], [0, 0, 1], [0, 0, 1]], atol=1e-14)
    assert on_proxy.dynamic.tolist() == [False, True, True]
    assert on_proxy.group.tolist() == [6, 5, 5] and on_proxy.merged == 0


def test_nearest_mode_turns_the_offset_with_the_group_and_averages_at_one_sample(body):
    remeshed = remesh(body, 40, seed=2)
    index = np.flatnonzero(np.isin(remeshed.region, [3, 4]))
    turn, shift = rotation(8), np.array([1.0, 0, 2])
    rigid = Handles(index, body.V[index] @ turn.T + shift)
    on_proxy = proxy_handles(rigid, body, remeshed, mode="nearest")
    assert on_proxy.index.tolist() == [3, 4] and on_proxy.merged == len(index) - 2
    expected = body.V[remeshed.samples[[3, 4]]] @ turn.T + shift
    assert np.allclose(on_proxy.target, expected, rtol=0, atol=ROUNDING * body.diagonal)

    target = np.random.default_rng(0).normal(size=(len(index), 3))
    on_proxy = proxy_handles(Handles(index, target), body, remeshed, mode="nearest")
    R, _ = rigid_motion(body.V[index], target)
    sample = body.V[remeshed.samples[remeshed.region[index]]]
    moved = target + (sample - body.V[index]) @ R.T
    for i, s in enumerate((3, 4)):
        mean = moved[remeshed.region[index] == s].mean(axis=0)
        assert np.allclose(on_proxy.target[i], mean, rtol=0, atol=1e-13)


def test_in_nearest_mode_the_proxy_does_not_depend_on_the_handles(body_task):
    seen = []

    def spy(task, *, seed, progress=silent):
        seen.append(task)
        return bending(task, seed=seed)

    deform(body_task, vertices=50, samplings=1, coarse=spy, handle_mode="nearest", seed=3)
    expected = proxy_mesh(body_task.mesh, remesh(body_task.mesh, 50, seed=(3, 0)))
    assert np.array_equal(seen[0].mesh.V, expected.V)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"samplings": 0}, "0 samplings were asked for"),
        ({"workers": -1}, "-1 workers were asked for"),
        ({"workers": 0}, "0 workers were asked for"),
        ({"handle_mode": "first"}, "unknown handle mode 'first'; use 'samples' or 'nearest'"),
        ({"projection": "normal"}, "unknown projection 'normal'; use 'fan' or 'surface'"),
        ({"frame_function": "q"}, "unknown frame function 'q'"),
        ({"frame_function": np.ones(5)}, "needs 642 values"),
        ({"vertices": 643}, "the mesh has only 642"),
        ({"vertices": 5}, r"5 proxy vertices cannot hold the \d+ handle vertices"),
        ({"seed": -1}, "seed"),
    ],
)
def test_unusable_parameters_are_refused(body_task, arguments, words):
    with pytest.raises(InputError, match=words):
        deform(body_task, **{"vertices": 60, "samplings": 2, "coarse": bending, **arguments})


def test_unsuitable_meshes_are_refused_before_any_work(body):
    F = body.F.copy()
    F[0] = F[0, ::-1]
    pair = Mesh(np.concatenate([body.V, body.V + 9]), np.concatenate([body.F, body.F + body.n]))
    for mesh, words in ((Mesh(body.V, F), "oriented"), (pair, "2 components")):
        task = DeformationTask("bad", mesh, Handles([0, mesh.n - 1], mesh.V[[0, -1]]))
        with pytest.raises(InputError, match=words):
            deform(task, vertices=60)


def test_the_first_result_starts_the_others(body_task):
    """Each later proxy's task carries the first M' at its samples as a guess, on any number of threads."""
    results = {}

    def solver(task, *, seed, progress=silent) -> DeformationResult:
        result = bending(task, seed=seed)
        results[task.name] = (task, result)
        return result

    for workers in (1, 2, 3):
        results.clear()
        deform(body_task, vertices=70, samplings=3, coarse=solver, warm_start=True, workers=workers, seed=2)
        number = {int(name.split()[-1]): run for name, run in results.items()}
        first, solved = number[0]
        assert first.guess is None
        binding = bind(body_task.mesh, 70, first=body_task.handles.index, seed=(2, 0))
        carried = binding.carry(solved.vertices)[0]
        for i in (1, 2):
            remeshed = remesh(body_task.mesh, 70, first=body_task.handles.index, seed=(2, i))
            assert np.array_equal(number[i][0].guess, carried[remeshed.samples])


def test_a_warm_start_saves_iterations_and_moves_the_result_little(body_task):
    cold = deform(body_task, vertices=100, samplings=3)
    warm = deform(body_task, vertices=100, samplings=3, warm_start=True)
    assert warm.iterations < cold.iterations
    gap = np.linalg.norm(warm.vertices - cold.vertices, axis=1).max() / body_task.mesh.diagonal
    assert 0 < gap < 1e-3


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_an_error_in_the_first_sampling_ends_those_that_wait_for_it(body_task, workers):
    def failing(task, *, seed, progress=silent) -> DeformationResult:
        raise FloatingPointError("no luck")

    with pytest.raises(FloatingPointError, match="no luck"):
        deform(body_task, vertices=70, samplings=3, coarse=failing, warm_start=True, workers=workers)


def test_a_guess_takes_the_place_of_the_start(body_task):
    guess = bent(body_task.mesh.V, 0.2)
    task = DeformationTask("guess", body_task.mesh, body_task.handles, guess=guess)
    expected = guess.copy()
    expected[task.handles.index] = task.handles.target
    for start in ("rest", "rigid"):
        assert np.array_equal(initial_guess(task, start), expected)
    with pytest.raises(InputError, match="guess has shape"):
        DeformationTask("guess", body_task.mesh, body_task.handles, guess=guess[1:])


def test_a_shared_graph_changes_no_bit():
    mesh = bumpy(3)
    alone, shared = remesh(mesh, 90, seed=1), remesh(mesh, 90, seed=1, graph=vertex_graph(mesh))
    for name, value in vars(alone).items():
        assert np.array_equal(value, getattr(shared, name)), name

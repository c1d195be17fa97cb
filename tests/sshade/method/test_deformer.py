"""Bind once, deform many times."""

import sys
import threading
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from sshade import DeformationTask, Deformer, Handles, InputError, Mesh, deform
from sshade.core.threads import ThreadTeam
from sshade.method import piece as piece_module
from sshade.problem.options import GROUPS
from sshade.solver import system as system_module
from tests.shapes import beside, bumpy, end_handles, moved_parts, of_all, rotation, shifted, tube
from tests.sshade.mesh.test_cutting import moebius, t_fin
from tests.sshade.method.calls import fast


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return bumpy()


@pytest.fixture(scope="module")
def held(mesh: Mesh) -> np.ndarray:
    return end_handles(mesh.V, count=8).index


@pytest.fixture
def drag(mesh: Mesh, held: np.ndarray) -> Deformer:
    return Deformer(mesh, held, vertices=150)


def lifted(mesh: Mesh, held: np.ndarray, height: float) -> np.ndarray:
    return mesh.V[held] + np.where(np.arange(16) < 8, 0.0, height)[:, None] * [0.5, 0, 1]


@pytest.mark.parametrize("soup", [False, True])
def test_a_drag_takes_what_deform_takes(mesh, held, soup):
    V, F = mesh.V, mesh.F
    mask, target = np.isin(np.arange(mesh.n), held), V.copy()
    target[held] = lifted(mesh, held, 0.4)
    if soup:
        V, mask, target = V[F].reshape(-1, 3), mask[F].ravel(), target[F].reshape(-1, 3)
        F = np.arange(len(V)).reshape(-1, 3)
    shape = (V, F) if soup else (trimesh.Trimesh(V, F, process=False),)
    expected = deform(V, F, mask, target[mask], vertices=150)
    drag, out = Deformer(*shape, mask, vertices=150), np.empty_like(V)
    np.testing.assert_array_equal(drag.step(target[mask], out=out).vertices, expected)
    np.testing.assert_array_equal(out, expected)
    index = np.random.default_rng(0).permutation(np.flatnonzero(mask))
    drag.rebind(index)
    assert np.abs(drag.step(target[index]).vertices - expected).max() < 0.01 * mesh.diagonal


#: Shapes, weights of their handles, options, and how far a drag may be from a call, over the diagonal. A drag
#: keeps its state between the solves that junctions, sides and goals need.
FIRST = {
    "one": (bumpy(3), np.inf, {}, 0.0),
    "soft": (bumpy(3), 3.0, {}, 0.0),
    "samplings": (bumpy(3), np.inf, {"method": "paper", "samplings": 2}, 0.0),
    "two": (beside(bumpy(3), shifted(bumpy(3), [4, 0, 0])), np.inf, {}, 0.0),
    "a fin": (t_fin(6), np.inf, {}, 1e-3),
    "one side": (moebius(40), np.inf, {}, 1e-3),
    "a goal": (bumpy(3), np.inf, {"volume_goal": 1.1}, 1e-3),
}


@pytest.mark.parametrize("name", FIRST)
def test_a_first_step_and_one_after_a_reset_deform_as_a_call_does(name):
    mesh, weight, options, close = FIRST[name]
    V, ends = mesh.V, []
    for component in range(mesh.component.max() + 1):
        own = np.flatnonzero(mesh.component == component)
        own = own[np.argsort(V[own] @ [0.1, 0, 1])]
        ends += [(own[:8], 0), (own[-8:], lambda P: 0.8 * P + 0.2 * P @ rotation(1).T + [0.1, 0.05, 0.1])]
    own = moved_parts(V, *ends, weights=[np.inf, weight] * (len(ends) // 2))
    once = deform(DeformationTask("t", mesh, own), vertices=150, **options).vertices
    drag = Deformer(mesh, own.index, group=own.group, weight=own.weight, vertices=150, **options)
    first = drag.step(own.target).vertices
    drag.step(V[own.index])
    drag.reset()
    for found in (first, drag.step(own.target).vertices):
        assert np.abs(found - once).max() <= close * mesh.diagonal


@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning", "ignore:invalid:RuntimeWarning")
def test_a_call_that_fails_leaves_no_trace(mesh, held, drag):
    first = drag.step(lifted(mesh, held, 0.2)).vertices
    for _ in range(2):
        with pytest.raises(FloatingPointError):
            drag.step(1e160 * lifted(mesh, held, 0.2))
    np.testing.assert_array_equal(drag.step(lifted(mesh, held, 0.2)).vertices, first)


def bound_and_task(name: str, **options):
    """Return a Deformer and a task with the same handles: patches, soft handles or regions of a shape."""
    mesh = {"bumpy": bumpy(4), "soft": bumpy(4), "regions": bumpy(4), "bar": tube(30, 80, length=7.0)}[name]
    order = np.argsort(mesh.V[:, 2])
    count = {"bumpy": 12, "soft": 12, "regions": mesh.n // 4, "bar": 20}[name]
    centre, turn = mesh.V[order[-count:]].mean(axis=0), Rotation.from_rotvec([0.5, 0, 0])
    own = moved_parts(
        mesh.V,
        (order[:count], 0),
        (order[-count:], lambda V: centre + turn.apply(V - centre) + [0.2, 0.1, 0.1]),
        weights=[np.inf, 5.0 if name == "soft" else np.inf],
    )
    drag = Deformer(mesh, own.index, group=own.group, weight=own.weight, vertices=300, **options)
    return drag, DeformationTask("t", mesh, own)


#: Another value than the default of `fast` for each option of the energy.
OTHER_ENERGY = {"volume": 0.01, "volume_goal": 1.2, "stiffness": 0.5, "strain": 0.1, "strain_limit": 0.02}
OTHER_ENERGY |= {"area": 0.0, "attachment": 3.0, "bending": 0.1, "thickness": 1.0, "joints": 0.2}


@pytest.mark.parametrize("option", GROUPS["Energy"])
def test_a_drag_has_the_energy_of_the_method(mesh, option):
    """Also for an option that is new in the list."""
    ends, middle = end_handles(mesh.V, count=4).index, np.argsort(abs(mesh.V[:, 2]))[:40:10]
    index, group = np.concatenate([ends, middle]), np.array([0] * 4 + [1] * 4 + [2, 3, 4, 5])
    target = mesh.V[index] + np.outer(group == 1, [0.3, 0, 0.4])
    task = DeformationTask("t", mesh, Handles(index, target, group=group))
    plain, other = (deform(task, vertices=150, **more) for more in ({}, {option: OTHER_ENERGY[option]}))
    drag = Deformer(mesh, index, group=group, vertices=150, **{option: OTHER_ENERGY[option]})
    changed = np.abs(other.vertices - plain.vertices).max()
    assert changed > 1e-4
    assert np.abs(drag.step(target).vertices - other.vertices).max() < 0.01 * changed


@pytest.mark.parametrize("name", ["bumpy", "bar", "soft", "regions"])
def test_a_drag_settles_where_the_method_ends_and_leads_back(name):
    drag, task = bound_and_task(name, joints=0)
    mesh, handles = task.mesh, task.handles
    rest, out = mesh.V[handles.index], np.empty_like(mesh.V)

    def along(shares: np.ndarray):
        for share in shares:
            result = drag.step(rest + share * (handles.target - rest), tolerance=1e-4, out=out)
            assert result.vertices is out
        return result

    def apart(V: np.ndarray, W: np.ndarray) -> float:
        return np.linalg.norm(V - W, axis=1).max() / mesh.diagonal

    first, once = drag.step(handles.target).vertices, fast(task, vertices=300, joints=0).vertices
    # The results differ only where the proxy has to correct the volume deficit of regions.
    assert apart(first, once) <= (1e-4 if name == "regions" else 0.0)
    minimum = drag.settle().vertices
    drag.reset()
    before = drag.step(rest).vertices
    last = along(np.linspace(0, 1, 13)[1:])
    settled = drag.settle()
    assert settled.converged and apart(settled.vertices, minimum) < 3e-4
    # With regions, the two energies belong to different volume goals.
    assert settled.facts.energy <= last.facts.energy or name == "regions"
    assert name != "bumpy" or drag.step(handles.target).iterations == 1  # nothing has moved
    there = drag.step(handles.target, tolerance=1e-8)
    assert there.converged and there.facts.residual < 1e-8
    assert apart(there.vertices, settled.vertices) < 1e-4
    assert apart(there.vertices, fast(task, vertices=300, joints=0, tolerance=1e-8).vertices) < 1e-3
    if name != "soft":
        assert np.abs(there.vertices[handles.index] - handles.target).max() < 1e-12
    if name == "regions":
        assert Mesh(there.vertices, mesh.F).volume == pytest.approx(mesh.volume, rel=1e-3)
    along(np.linspace(1, 0, 13)[1:])
    assert apart(drag.step(rest, tolerance=1e-8).vertices, before) < 1e-3
    assert apart(there.vertices, before) > 0.02


def test_rotations_may_come_and_go_in_a_drag():
    """A single handle has an attachment once it is turned; the system with this pull is then made."""
    mesh = tube(30, 80, length=7.0)
    z = mesh.V[:, 2]
    parts = (np.argsort(z)[:20], 0), ([np.argmin(np.abs(z - z.max()) + np.abs(mesh.V[:, 0]))], 0)
    turned = moved_parts(mesh.V, *parts, rotations=[None, [[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]]])
    drag, rest = Deformer(mesh, turned.index, group=turned.group, vertices=400, joints=0), turned.target
    still = drag.step(rest, tolerance=1e-7).vertices
    piece = drag._pieces[0]
    for _ in range(2):
        there = drag.step(rest, rotations=turned.rotation, tolerance=1e-7).vertices
    assert np.abs(drag.settle().vertices - there).max() < 1e-3 * mesh.diagonal and drag._pieces[0] is piece
    once = fast(DeformationTask("turned", mesh, turned), vertices=400, joints=0, tolerance=1e-7).vertices
    assert np.linalg.norm(there - once, axis=1).max() < 1e-3 * mesh.diagonal
    for _ in range(2):
        back = drag.step(rest, tolerance=1e-7).vertices
    assert np.abs(there - still).max() > 0.02 * mesh.diagonal
    assert np.linalg.norm(back - still, axis=1).max() < 1e-3 * mesh.diagonal


def rebound(mesh, held, index) -> Deformer:
    drag = Deformer(mesh, held, vertices=150)
    drag.step(mesh.V[held])
    drag.rebind(index)
    return drag


REFUSED = {
    "no method 'fin' here; did you mean 'fine'": lambda mesh, held: Deformer(mesh, held, method="fin"),
    "no use for the option 'proxy_method'": lambda mesh, held: Deformer(mesh, held, proxy_method=print),
    "given twice": lambda mesh, held: Deformer(mesh, [1, 1]),
    "handle ids must be integers": lambda mesh, held: rebound(mesh, held, [0.7, 5.9]),
    "nothing to settle: no targets": lambda mesh, held: Deformer(mesh, held, vertices=150).settle(),
    "nothing to settle": lambda mesh, held: rebound(mesh, held, held[:8]).settle(),
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_a_drag_cannot_do_is_refused(mesh, held, words):
    with pytest.raises(InputError, match=words):
        REFUSED[words](mesh, held)


def test_a_single_handle_that_is_no_sample_is_met():
    """The surface turns sharply, so a target at the nearest sample alone would not bring the handle there."""
    mesh = tube(40, 120, length=7.0)
    order = np.argsort(mesh.V[:, 2])
    drag = Deformer(mesh, order[:20], vertices=600, joints=0)
    samples = drag._pieces[0].kept[0].sampling.samples
    top = mesh.V[:, 2] > 0.8 * mesh.V[:, 2].max()
    new = np.flatnonzero(top & ~np.isin(np.arange(mesh.n), samples))[7]
    own = moved_parts(mesh.V, (order[:20], 0), ([new], [2.0, 0.0, -1.5]))
    drag.rebind(own.index, group=own.group)
    off = [np.linalg.norm(drag.step(own.target).vertices[new] - own.target[-1])]
    settled = drag.settle().vertices
    assert np.linalg.norm(settled[new] - own.target[-1]) < 1e-4 * mesh.diagonal
    for share in np.linspace(1, 0.5, 11):
        aim = mesh.V[own.index] + share * (own.target - mesh.V[own.index])
        off.append(np.linalg.norm(drag.step(aim, tolerance=1e-4).vertices[new] - aim[-1]))
    assert max(off) < 2e-3 * mesh.diagonal


@pytest.mark.parametrize("weight", [np.inf, 20.0])
def test_other_handles_are_taken_without_binding_anew(weight):
    mesh = tube(40, 120, length=7.0)
    z = mesh.V[:, 2]
    low, high = np.argsort(z)[:20], np.argsort(z)[-20:]
    ends = moved_parts(mesh.V, (low, 0), (high, [0.4, 0, 0]))
    others = moved_parts(mesh.V, (low, 0), (np.argsort(np.abs(z - z.mean()))[:20], [0.5, 0, 0]))
    drag = Deformer(mesh, ends.index, group=ends.group, vertices=600)
    own = {"group": others.group, "weight": weight}
    drag.step(ends.target)
    drag.rebind(others.index, **own)
    drag.step(others.target)
    moved = drag.step(others.target, tolerance=1e-7).vertices
    anew = Deformer(mesh, others.index, **own, vertices=600).step(others.target, tolerance=1e-7).vertices
    assert np.linalg.norm(moved - anew, axis=1).max() < 0.03 * mesh.diagonal
    off = np.linalg.norm(moved[others.index] - others.target, axis=1).max()
    assert off < (0.01 if weight == np.inf else 0.05) * mesh.diagonal
    drag.rebind(ends.index, group=ends.group)
    drag.step(mesh.V[ends.index])
    still = drag.step(mesh.V[ends.index], tolerance=1e-7).vertices
    assert np.abs(still - mesh.V).max() < 1e-4 * mesh.diagonal


def test_a_reset_forgets_where_rebound_handles_missed_their_targets(mesh, held, drag):
    others = np.setdiff1d(np.argsort(mesh.V[:, 2])[[*range(12), *range(-12, 0)]], held)
    drag.rebind(others)
    drag.step(mesh.V[others] + np.where(mesh.V[others, 2:] > 0, [0.3, 0, 0.2], 0.0))
    drag.reset()
    assert np.abs(drag.step(mesh.V[others]).vertices - mesh.V).max() < 1e-12 * mesh.diagonal


def test_handles_that_cannot_be_rebound_leave_everything_as_it_was(mesh, held, monkeypatch):
    """The handles are too far from the second proxy only."""
    drag = Deformer(mesh, held, vertices=150, samplings=2)
    before = drag.step(lifted(mesh, held, 0.3)).vertices
    second, place = drag._pieces[0].kept[1].mesh, piece_module.NearestPlacement

    def placed(mesh, proxy, rest):
        if proxy is second:
            raise InputError("too far")
        return place(mesh, proxy, rest)

    monkeypatch.setattr(piece_module, "NearestPlacement", placed)
    with pytest.raises(InputError):
        drag.rebind([0])
    np.testing.assert_array_equal(drag.index, held)
    drag.reset()
    np.testing.assert_array_equal(drag.step(lifted(mesh, held, 0.3)).vertices, before)


def test_iterations_are_counted_over_all_solves_where_handles_are_regions():
    mesh = bumpy(4)
    grown = end_handles(mesh.V, count=int(0.3 * mesh.n), turn=1.2 * np.eye(3))
    options = {"vertices": 150, "tolerance": 0.0, "max_iterations": 8}
    assert fast(DeformationTask("grown", mesh, grown), **options).iterations == 8
    assert Deformer(mesh, grown.index, **options).step(grown.target).iterations == 8


def test_all_components_follow_a_drag_and_settle_where_deform_ends():
    """Two bodies are bent, a third one turns with its handles, and one without handles goes along."""
    body, step = bumpy(3), np.array([4.0, 0, 0])
    mesh = beside(body, shifted(body, step), shifted(body, 2 * step), shifted(body, [0.0, 3.5, 0]))
    own = [end_handles(body.V, count=12), end_handles(body.V, count=12, shift=[0, 0.3, 0.2])]
    placed = [replace(one, target=one.target + k * step) for k, one in enumerate(own)]
    turn = moved_parts(body.V + 2 * step, (own[0].index, [0, 0, 0.7]))
    handles = of_all((placed[0], 0), (placed[1], body.n), (turn, 2 * body.n))
    group = np.unique(np.stack([handles.group, handles.index // body.n]), axis=1, return_inverse=True)[1]
    task = DeformationTask("four", mesh, replace(handles, group=group))
    drag = Deformer(mesh, handles.index, group=group, vertices=600)
    rest = mesh.V[handles.index]
    for share in np.linspace(0.1, 1, 10):
        result = drag.step(rest + share * (handles.target - rest), tolerance=1e-4)
    assert np.abs(result.vertices[handles.index] - handles.target).max() < 1e-9
    out = np.empty_like(mesh.V)
    end, once = drag.settle(out=out).vertices, deform(task, vertices=600).vertices
    assert np.linalg.norm(end - once, axis=1).max() < 3e-3 * mesh.diagonal
    third = slice(2 * body.n, 3 * body.n)
    assert np.abs(end[third] - mesh.V[third] - [0, 0, 0.7]).max() < 1e-9
    assert np.linalg.norm(end[3 * body.n :] - mesh.V[3 * body.n :], axis=1).min() > 0
    assert end is out
    drag.reset()
    first = Deformer(mesh, handles.index, group=group, vertices=600).step(handles.target).vertices
    assert drag.step(handles.target, out=out).vertices is out
    np.testing.assert_array_equal(out, first)


def test_the_steps_of_fine_are_those_of_its_proxy_and_settling_polishes(mesh, held):
    target = lifted(mesh, held, 0.3)
    drag = Deformer(mesh, held, method="fine", vertices=150)
    assert drag.step(target).facts.proxy_iterations is None
    settled = drag.settle()
    assert settled.facts.proxy_iterations > 0
    once = deform(DeformationTask("t", mesh, Handles(held, target)), method="fine", vertices=150)
    assert np.linalg.norm(settled.vertices - once.vertices, axis=1).max() < 2e-2 * mesh.diagonal


def test_a_drag_of_a_large_mesh_carries_with_threads(mesh, held, monkeypatch):
    teams = []
    monkeypatch.setattr(piece_module, "ThreadTeam", lambda count: teams.append(count) or ThreadTeam(count))
    monkeypatch.setattr(piece_module, "available_cpus", lambda: 3)
    for large, threads in ((mesh.n + 1, 1), (mesh.n, 3)):
        monkeypatch.setattr(piece_module, "LARGE", large)
        Deformer(mesh, held, vertices=150)
        assert max(teams) == threads


def test_a_drag_factorises_once_and_keeps_its_pairs(mesh, held, monkeypatch):
    made = []
    factorised = system_module.Factorised
    drag = Deformer(mesh, held, vertices=150)
    drag.step(lifted(mesh, held, 0.2))
    monkeypatch.setattr(system_module, "Factorised", lambda *a: made.append(1) or factorised(*a))
    targets = [lifted(mesh, held, lift) for lift in (0.21, 0.22, 0.23)]
    iterations = [drag.step(target, tolerance=1e-4).iterations for target in targets]
    assert not made and max(iterations) <= 6


#: What depends on the rest shape alone, and what depends on the handle vertices as well, by their names.
OF_THE_MESH = {"sample_proxy", "bind_proxy", "OrderedMesh.__init__", "touching", "cut_to_manifold"}
OF_THE_HANDLES = {"splu", "_cs_matrix._matmul_sparse", "Fronts.__init__", "VertexMaps.at_rest", "harmonic"}
OF_THE_HANDLES |= {"Mesh.__init__", "HandleRegions.__init__", "Attachment.__init__", "Descent.project"}


def called(work) -> set[str]:
    """Return the names of the functions that are called."""
    names = set[str]()

    def note(frame, event, _):
        if event == "call":
            names.add(frame.f_code.co_qualname)

    threading.setprofile(note)
    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return names


@pytest.mark.parametrize("name", ["bumpy", "soft", "regions"])
def test_what_does_not_depend_on_targets_is_made_once(name):
    drag, task = bound_and_task(name, joints=0)
    mesh, own = task.mesh, task.handles
    rest = mesh.V[own.index]
    steps = iter(rest + np.linspace(0, 0.5, 12)[:, None, None] * (own.target - rest))
    for _ in range(3):
        drag.step(next(steps), tolerance=1e-4)
    made = called(lambda: drag.step(next(steps), tolerance=1e-4))
    assert "Bound.step" in made and not made & (OF_THE_MESH | OF_THE_HANDLES)
    drag.solve(own.target)
    # The guide of a solve is a system of its own.
    assert not called(lambda: drag.solve(next(steps))) & OF_THE_MESH - {"OrderedMesh.__init__"}
    few = np.isin(own.index, drag._pieces[0].kept[0].sampling.samples)
    taken = {"group": own.group[few], "weight": own.weight[few]}
    assert not called(lambda: drag.rebind(own.index[few], **taken)) & OF_THE_MESH


def test_a_step_into_an_array_takes_no_memory_for_the_vertices():
    mesh = bumpy(5)
    own, out = end_handles(mesh.V, count=8, shift=[0.2, 0, 0]), np.empty_like(mesh.V)
    drag, peak = Deformer(mesh, own.index, vertices=60), {}
    for share, given in ((0.1, None), (0.2, None), (0.3, out)):
        tracemalloc.start()
        drag.step(mesh.V[own.index] + share * (own.target - mesh.V[own.index]), out=given)
        peak[given is out] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak[True] < peak[False] - 0.8 * out.nbytes


def test_a_result_is_not_overwritten_by_the_next_one(mesh, held):
    drag = Deformer(mesh, held, vertices=150)
    first = drag.step(lifted(mesh, held, 0.2)).vertices
    kept = first.copy()
    drag.step(lifted(mesh, held, 0.4))
    drag.settle()
    np.testing.assert_array_equal(first, kept)


def test_nothing_of_the_first_regions_is_left_where_a_deformer_takes_other_handles(mesh):
    regions, others = end_handles(mesh.V, share=0.1), end_handles(mesh.V, count=5, shift=[0.2, 0, 0.1])
    drag = Deformer(mesh, regions.index, group=regions.group, vertices=mesh.n, coarser=1)
    drag.step(regions.target)
    drag.rebind(others.index, group=others.group)
    for _ in range(3):
        drag.step(others.target)
    V, once = drag.settle().vertices, deform(DeformationTask("t", mesh, others), vertices=mesh.n, coarser=1)
    assert np.abs(V[others.index] - others.target).max() < 2e-3 * mesh.diagonal
    assert np.linalg.norm(V - once.vertices, axis=1).max() < 0.03 * mesh.diagonal

"""Bind once, deform many times."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from sshade import DeformationTask, Deformer, Handles, InputError, Mesh, deform
from sshade.core.threads import ThreadTeam
from sshade.method import piece as piece_module
from sshade.problem.options import GROUPS
from tests.shapes import beside, bumpy, end_handles, moved_parts, rotation, shifted, tube
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
OTHER_ENERGY = {"volume": 0.01, "volume_goal": 1.2, "stiffness": 0.2, "strain": 0.1, "strain_limit": 0.02}
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


def test_a_drag_of_a_large_mesh_carries_with_threads(mesh, held, monkeypatch):
    teams = []
    monkeypatch.setattr(piece_module, "ThreadTeam", lambda count: teams.append(count) or ThreadTeam(count))
    monkeypatch.setattr(piece_module, "available_cpus", lambda: 3)
    for large, threads in ((mesh.n + 1, 1), (mesh.n, 3)):
        monkeypatch.setattr(piece_module, "LARGE", large)
        Deformer(mesh, held, vertices=150)
        assert max(teams) == threads

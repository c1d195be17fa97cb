"""A session without a browser: groups are dragged, and steps are undone."""

from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from sshade import Deformer
from sshade.edit import dragging, state, workspace
from sshade.edit.groups import Motion
from sshade.edit.workspace import Superseded
from sshade.method.bound import Bound
from tests.shapes import beside, bumpy, rotation, shifted, strip
from tests.sshade.edit.sessions import BODY, LIFT, added, begun, ends, marked, ready, settled, turned
from tests.sshade.mesh.test_cutting import t_fin

pytestmark = pytest.mark.usefixtures("here")


@pytest.mark.parametrize("mesh", [BODY, strip(30, 12)], ids=["closed", "sheet"])
def test_a_drag_follows_the_group_and_comes_near_the_shape_at_rest(mesh):
    session, number = ready(mesh)
    V = session.mesh.V
    for step in np.linspace(0.05, 0.4, 8):
        shown = session.drag(number, turned(V, step))
        handles = session.state.moved(number, turned(V, step)).handles(session.mesh)
        assert shown is session.shown
        assert np.array_equal(shown[handles.index], handles.target)
    session.release(number, turned(V, 0.4))
    dragged = session.shown
    session.settle()
    mean = np.linalg.norm(session.shown - dragged, axis=1).mean()
    assert mean < 0.01 * session.mesh.diagonal
    assert mean < 0.1 * np.linalg.norm(session.shown - V, axis=1).mean()


def test_turns_of_a_single_vertex_add_up_and_targets_of_a_region_say_its_turn():
    session = begun()
    number = added(session, np.array([300]), "moved")
    for seed in (1, 2):
        session.release(number, Motion(rotation(seed), np.zeros(3)))
    assert np.allclose(session.state.group(number).rotation, rotation(2) @ rotation(1))
    region = added(session, ends(BODY.V)[1], "moved")
    session.release(region, Motion(rotation(1), np.zeros(3)))
    assert session.state.group(region).rotation is None


def test_undo_and_redo_bring_back_what_was_and_its_shape():
    session = begun()
    seen = [(session.state, session.shown)]
    number = marked(session)
    for amount in 0.2, 0.3:
        settled(session, number, turned(BODY.V, amount))
        seen.append((session.state, session.shown))
    session.select(np.arange(3), "replace")
    assert session.is_converged and session.state.shape is seen[-1][1]
    session.undo()
    session.undo()
    assert session.state is seen[1][0] and session.shown is seen[1][1] and session.is_converged
    session.redo()
    assert session.state is seen[2][0] and session.shown is seen[2][1]
    while session.history.can_undo:
        session.undo()
    assert session.state is seen[0][0] and np.array_equal(session.shown, BODY.V)
    session.undo()  # there is nothing before
    session.select(np.arange(4), "replace")
    assert not session.history.can_redo


@pytest.mark.parametrize("back", ["undo", "restore"])
def test_a_drag_goes_on_from_where_the_group_was_released_and_from_where_it_was_brought_back(back):
    session, number = ready()
    _, free = ends(BODY.V)
    session.release(number, LIFT)
    settled(session, number, LIFT)
    assert np.allclose(session.shown[free], BODY.V[free] + 2 * LIFT.t)
    session.drag(number, turned(BODY.V, 2.0))
    for _ in range(2 if back == "undo" else 0):
        session.undo()
    if back == "restore":
        session.restore(number)
    other, same = ready()
    assert np.array_equal(session.drag(number, LIFT), other.drag(same, LIFT))


def test_shapes_that_were_dropped_for_want_of_memory_are_computed_again(monkeypatch):
    monkeypatch.setattr(state, "BYTES", 3 * BODY.V.nbytes)
    session, number = ready()
    shapes = []
    for _ in range(5):
        shapes.append(settled(session, number, Motion(np.eye(3), np.array([0, 0, 0.05]))))
    for shape in reversed(shapes[:-1]):
        session.undo()
        session.settle()
        assert np.array_equal(session.shown, shape)
    assert sum(state.shape is None for state in session.history._states) >= 1


def test_a_result_is_not_shown_if_the_handles_changed_meanwhile(monkeypatch):
    session, number = ready()
    session.release(number, LIFT)
    compute = Bound.solve

    def disturbed(*arguments, **options):
        session.drag(number, LIFT)
        return compute(*arguments, **options)

    with monkeypatch.context() as patched, pytest.raises(Superseded):
        patched.setattr(Bound, "solve", disturbed)
        session.settle()
    assert not session.is_converged
    session.settle()
    assert session.is_converged


@pytest.mark.parametrize("newer", ["drag", "restore"])
def test_a_step_that_ends_after_a_newer_change_is_not_shown(monkeypatch, newer):
    session, number = ready()
    session.release(number, LIFT)
    step, shown = Deformer.step, []

    def late(self, *given, **options):
        found = step(self, *given, **options)
        if not shown:
            shown.append(None)
            shown[0] = session.drag(number, LIFT) if newer == "drag" else session.restore(number)
        return found

    monkeypatch.setattr(Deformer, "step", late)
    session.drag(number, turned(BODY.V, 0.4))
    if newer == "drag":
        assert session.shown is shown[0]
    else:
        assert session.is_converged and np.array_equal(session.shown, BODY.V)


def test_groups_marked_on_a_deformed_shape_stay_where_they_are():
    session, number = ready()
    before = settled(session, number, LIFT)
    middle = np.flatnonzero(np.abs(BODY.V[:, 2]) < 0.1)
    added(session, middle, "fixed")
    session.settle()
    assert np.array_equal(session.shown[middle], before[middle])
    assert np.abs(session.shown - before).max() < 0.05 * BODY.diagonal
    own = session.state.handles(session.mesh)
    assert own.dynamic[np.isin(own.index, middle)].all()  # a file's static ones would go back to rest
    session.restore(session.state.groups[-1].number)
    assert np.array_equal(session.state.groups[-1].target, BODY.V[middle])
    session.restore(number)
    assert session.is_converged and np.array_equal(session.shown, BODY.V)


def test_another_name_leaves_the_shape_and_another_weight_does_not():
    session, number = ready()
    shape = settled(session, number, LIFT)
    session.alter(number, name="tip")
    assert session.is_converged and session.shown is shape and session.is_unsaved
    session.alter(number, weight=1.0)
    assert not session.is_converged
    session.settle()
    gap = np.linalg.norm(session.shown - shape, axis=1)[session.state.group(number).vertices]
    assert gap.min() > 1e-3 * BODY.diagonal  # a soft group gives way
    for _ in range(20):  # also in a drag
        dragged = session.drag(number, Motion(np.eye(3), np.zeros(3)))
    own = session.state.group(number)
    assert np.abs(dragged[own.vertices] - own.target).max() > 0.3 * gap.mean()
    session.undo()
    assert session.shown is shape and session.state.group(number).name == "tip"


def test_a_drag_has_the_method_of_now_not_of_the_drag_before():
    session, number = ready()
    session.drag(number, LIFT)
    session.set_up("paper")
    other, same = ready(method="paper")
    motion = turned(BODY.V, 0.8)
    assert np.array_equal(session.drag(number, motion), other.drag(same, motion))


def test_the_dragged_component_follows_at_once_and_takes_one_without_handles_along():
    mesh = beside(BODY, shifted(BODY, [4, 0, 0]))
    session = begun(mesh)
    left = np.flatnonzero(mesh.V[:, 0] < 2)
    added(session, left[mesh.V[left, 2] < -0.6], "fixed")
    number = added(session, left[mesh.V[left, 2] > 0.6], "moved")
    shown = session.drag(number, LIFT)
    moved = np.abs(shown - mesh.V).max(axis=1)
    free = np.setdiff1d(left, np.concatenate([group.vertices for group in session.state.groups]))
    assert (moved[free] > 1e-4).mean() > 0.9 and moved[BODY.n :].max() > 1e-3
    settled(session, number, LIFT)
    assert np.abs(session.shown - shown)[BODY.n :].max() < 0.05 * BODY.diagonal


def test_a_mesh_that_is_no_manifold_follows_at_once():
    mesh = t_fin(4)
    session = begun(mesh)
    x = mesh.V[:, 0]
    added(session, np.flatnonzero(x <= x.min() + 1), "fixed")
    number = added(session, np.flatnonzero(x >= x.max() - 1), "moved")
    own = session.state.group(number).vertices
    shown = session.drag(number, LIFT)
    assert np.array_equal(shown[own], LIFT(mesh.V[own]))
    settled(session, number, LIFT)
    assert np.abs(session.shown - shown).max() < 0.05 * mesh.diagonal
    assert np.count_nonzero(np.abs(shown - mesh.V).max(axis=1) > 1e-6) > 2 * len(own)


def test_the_mesh_is_bound_once_while_the_vertices_of_the_handles_stay(monkeypatch):
    monkeypatch.setattr("sshade.edit.session.Thread", lambda **_: SimpleNamespace(start=lambda: None))
    session, number = ready()
    session.drag(number, LIFT)
    bound = Mock()
    for name in ("bound_for_drag", "bound_again"):
        monkeypatch.setattr(workspace, name, bound)
    for _ in range(2):
        session.release(number, LIFT)
        session.drag(number, LIFT)
        session.restore(number)
        session.alter(number, name="tip")
    session.drag(number, LIFT)
    assert bound.call_count == 0


def test_large_meshes_take_other_handles_without_being_bound_anew(monkeypatch):
    bound = []
    deformer = dragging.Deformer
    monkeypatch.setattr(dragging, "Deformer", lambda *a, **k: bound.append(1) or deformer(*a, **k))
    body = bumpy(5)
    monkeypatch.setattr(dragging, "REBOUND", 0)
    session = begun(body)
    monkeypatch.setattr("sshade.edit.session.Thread", lambda **_: SimpleNamespace(start=lambda: None))
    number = marked(session)
    session.drag(number, LIFT)
    added(session, np.flatnonzero(np.abs(body.V[:, 2]) < 0.1), "fixed")
    shown = session.drag(number, LIFT)
    target = session.state.moved(number, LIFT).group(number)
    assert np.abs(shown[target.vertices] - target.target).max() < 0.01 * body.diagonal
    assert len(bound) == 1

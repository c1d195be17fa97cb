"""A session without a browser: groups are dragged, and steps are undone."""

import numpy as np
import pytest

from sshade import Deformer
from sshade.edit import state
from sshade.edit.groups import Motion
from sshade.edit.workspace import Superseded
from sshade.method.bound import Bound
from tests.sshade.edit.sessions import BODY, LIFT, ends, ready, settled, turned

pytestmark = pytest.mark.usefixtures("here")


@pytest.mark.parametrize("back", ["undo", "restore"])
def test_a_drag_goes_on_from_where_the_group_was_released_and_from_where_it_was_brought_back(back):
    session, number = ready()
    _, free = ends(BODY.V)
    session.select(np.arange(3), "replace")
    session.release(number, LIFT)
    settled(session, number, LIFT)
    assert np.allclose(session.shown[free], BODY.V[free] + 2 * LIFT.t)
    session.drag(number, turned(BODY.V, 2.0))
    for _ in range(3 if back == "undo" else 0):  # both moves, and the selection before
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

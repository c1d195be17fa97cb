"""A session without a browser: saved files, and the command that repeats them."""

import numpy as np
import pytest

from sshade.cli.main import main
from sshade.files.meshes import read_arrays
from tests.sshade.edit.sessions import BODY, edited, switched

pytestmark = pytest.mark.usefixtures("here")


@pytest.mark.parametrize(("method", "single"), [("fast", True), ("fine", False), ("paper", False)])
def test_one_command_repeats_a_session_in_which_everything_was_switched(method, single):
    session = switched(single=single)
    session.set_up(method)
    assert not session.is_converged
    session.settle()
    assert session.is_unsaved and session.save("handles", "body_handles.json") and not session.is_unsaved
    posed = session.shown
    assert main(session.document.command.split()[1:]) == 0
    again = read_arrays("body_deformed.ply")[0]
    session.save("mesh", "posed.ply")
    expected = read_arrays("posed.ply")[0]
    assert np.abs(again - expected).max() < 1e-6 * BODY.diagonal
    assert np.abs(posed - session.mesh.V)[: BODY.n].max() > 0.05
    opened = edited(begin="body_handles.json", weld=1e-6, repair=True)
    assert not opened.history.can_undo and not opened.is_unsaved
    for one, new in zip(session.state.groups, opened.state.groups, strict=True):
        assert (one.name, one.weight) == (new.name, new.weight)
        assert np.array_equal(one.vertices, new.vertices) and np.array_equal(one.target, new.target)
        # The targets of a region determine its rotation. A single vertex needs a stored rotation.
        assert (one.rotation is None) == (new.rotation is None)
        assert one.rotation is None or np.allclose(one.rotation, new.rotation)

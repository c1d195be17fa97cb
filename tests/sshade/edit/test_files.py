"""A session without a browser: saved files, and the command that repeats them."""

from pathlib import Path

import numpy as np
import pytest

from sshade import InputError, read_handles
from sshade.cli.main import main
from sshade.files.meshes import read_arrays
from tests.sshade.edit.sessions import BODY, begun, edited, marked, switched

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


def test_only_files_beside_the_mesh_or_named_in_advance_are_written(here):
    (here / "out").mkdir()
    (here / "other.json").write_text("mine")
    session = begun(output=here / "out" / "posed.obj", handles=Path("pose.json"))
    marked(session)
    for name in "../pose.json", "/tmp/pose.json", "", "..", "x.txt", "pose", "a\0.json", 300 * "x" + ".json":
        with pytest.raises(InputError):
            session.save("handles", name, over=True)
    with pytest.raises(InputError, match="exists already"):
        session.save("handles", "other.json")
    assert (here / "other.json").read_text() == "mine"
    session.save("handles", "other.json", over=True)
    session.save("handles", "other.json")  # the editor has written it and may replace it
    assert read_handles("other.json", BODY).index.size
    assert session.save("mesh", "posed.obj")[0] == here / "out" / "posed.obj"
    command = session.document.command
    assert "out/posed.obj" in command and "other.json" in command
    with pytest.raises(InputError, match="is the mesh"):
        begun().save("mesh", "body.ply", over=True)
    for wrong in {"output": "body.ply"}, {"output": "no/out.ply"}, {"handles": "a.ply"}:
        with pytest.raises(InputError):
            begun(**{name: Path(path) for name, path in wrong.items()})

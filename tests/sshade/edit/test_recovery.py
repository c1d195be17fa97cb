"""Unsaved work is kept in a file after each step, and another session continues from it."""

from pathlib import Path

import numpy as np
import pytest

from sshade import InputError
from sshade.edit import recovery
from sshade.edit.session import Session
from tests.shapes import bumpy, rotation
from tests.sshade.edit.sessions import BODY, SWITCHED, added, begun, edited, switched, turned

pytestmark = pytest.mark.usefixtures("here")


def abandoned(session: Session, monkeypatch) -> Path:
    """The recovery file of a session, whose process counts as ended."""
    monkeypatch.setattr(recovery, "_is_running", lambda *_, **__: False)
    return session.recovery.path


def files() -> list[Path]:
    return sorted(Path().glob("*.recovery-*"))


@pytest.mark.parametrize("single", [True, False])
def test_every_kind_of_group_comes_back_bit_by_bit(single, monkeypatch):
    session = switched(single=single)
    session.alter(session.state.groups[-1].number, turn=rotation(1), is_prescribed=True)
    session.set_up("fine")
    session.select(np.arange(7), "replace")
    abandoned(session, monkeypatch)
    again = edited(weld=1e-6, repair=True)
    (offer,) = again.recovery.offers
    assert offer.path == session.recovery.path and offer.groups == len(SWITCHED)
    again.recover()
    assert files() == [again.recovery.path] and again.is_unsaved and again.recovery.offers == []
    one, new = session.state, again.state
    assert new.method == one.method and np.array_equal(new.selection, one.selection)
    for a, b in zip(one.groups, new.groups, strict=True):
        for name in vars(a).keys() - {"number"}:
            assert np.array_equal(getattr(a, name), getattr(b, name)), name
    again.undo()
    assert again.state.groups == ()


def test_a_step_writes_the_file_and_a_save_or_an_undo_of_all_removes_it():
    session = begun()
    assert files() == []
    session.select(np.arange(5), "replace")
    assert len(files()) == 1
    number = session.mark("moved")
    before = files()[0].read_bytes()
    session.release(number, turned(BODY.V, 0.1))
    assert files() == [session.recovery.path] and files()[0].read_bytes() != before
    session.save("handles", "pose.json")
    assert files() == []
    opened = begun(begin="pose.json")
    assert files() == [] and len(opened.state.groups) == 1  # a file has this work
    session.undo()
    assert len(files()) == 1
    assert edited().recovery.offers == []  # its process still runs
    session.end(1)  # without a save: the work stays
    assert len(files()) == 1
    for _ in range(3):
        session.undo()
    assert files() == []


def test_files_of_another_mesh_and_damaged_files_are_refused_in_a_sentence(monkeypatch):
    session = begun()
    added(session, np.arange(5), "fixed")
    path = abandoned(session, monkeypatch)
    content = path.read_bytes()
    other = begun(bumpy(2))
    with pytest.raises(InputError, match="recovery file of another mesh"):
        other.recover()
    assert other.state.groups == () and path.read_bytes() == content
    again = begun()
    path.write_bytes(content[:-200])
    with pytest.raises(InputError, match="not a recovery file"):
        again.recover()
    path.write_bytes(content)
    Path("body.ply.recovery-0.npz").write_bytes(content[:-200])
    again = begun()
    assert [offer.path for offer in again.recovery.offers] == [path]
    again.discard()
    assert not path.exists() and again.recovery.offers == []

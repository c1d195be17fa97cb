"""Groups that follow other groups as mirror images."""

import json
from pathlib import Path

import numpy as np
import pytest

from sshade import InputError, Slide
from sshade.cli.main import main
from sshade.edit import recovery
from sshade.edit.groups import Motion
from sshade.edit.session import Session
from sshade.io.meshes import read_arrays
from tests.shapes import beside, icosphere, shifted
from tests.sshade.edit.sessions import BODY, added, along_edges, begun, settled, turned

pytestmark = pytest.mark.usefixtures("here")

BALL = icosphere(3)  # symmetric in all coordinate planes
ACROSS = np.diag([-1.0, 1, 1])


def caps(both: bool = True) -> np.ndarray:
    """Return the vertices of two opposite caps, or only of the cap at positive x."""
    side = BALL.V @ [0.96, 0.28, 0]
    other = BALL.V @ [-0.96, 0.28, 0]
    return np.flatnonzero((side > 0.93) | ((other > 0.93) & both))


def images(vertices=slice(None)) -> np.ndarray:
    """Return the vertex of the ball that is the mirror image of each of some vertices, or of all."""
    return np.linalg.norm(BALL.V[vertices, None] @ ACROSS - BALL.V, axis=2).argmin(axis=1)


def assert_mirrored(one, other) -> None:
    at = np.searchsorted(other.vertices, images(one.vertices))
    assert np.array_equal(other.vertices[at], images(one.vertices))
    assert np.abs(other.target[at] - one.target @ ACROSS).max() < 1e-12


def test_with_symmetry_picks_and_movable_groups_are_on_both_sides_and_move_alike():
    session = begun(BALL)
    session.mirror_picks(0)
    session.select(caps(both=False), "replace")
    assert session.state.selection.tolist() == caps().tolist()
    session.select(caps(both=False)[:3], "remove")
    assert len(session.state.selection) == len(caps()) - 6
    session.select(caps(both=False), "add")
    number = session.mark("moving")
    one, other = session.state.groups
    assert one.number == number and other.link.leader == number
    assert sorted([*one.vertices, *other.vertices]) == caps().tolist()
    assert (BALL.V[one.vertices, 0] > 0).all() and (BALL.V[other.vertices, 0] < 0).all()
    motion = turned(BALL.V, 0.3)
    shown = session.drag(number, motion)
    assert np.abs(shown[other.vertices][:, 0].mean() + shown[one.vertices][:, 0].mean()) < 1e-9
    session.release(number, motion)
    one, other = session.state.groups
    assert_mirrored(one, other)
    # A motion of the image moves the leader by the mirrored motion.
    before = one.target
    session.release(other.number, Motion(np.eye(3), np.array([0.1, 0.2, 0])))
    one, other = session.state.groups
    assert np.allclose(one.target, before + [-0.1, 0.2, 0])
    assert_mirrored(one, other)
    session.settle()
    assert np.abs(session.shown[images()] - session.shown @ ACROSS).max() < 0.02
    session.restore(other.number)
    assert not session.state.displaced(session.mesh)
    session.undo()
    assert_mirrored(*session.state.groups)


def test_a_piece_across_the_middle_moves_alone_and_fixed_groups_stay_one():
    session = begun(BALL)
    session.mirror_picks(0)
    top = np.flatnonzero(BALL.V[:, 1] > 0.95)
    added(session, np.union1d(caps(both=False), top), "moving")
    middle, one, other = session.state.groups
    assert middle.vertices.tolist() == top.tolist() and middle.link is None
    assert other.link.leader == one.number
    added(session, caps(), "static")
    assert len(session.state.groups) == 2
    session.mirror_picks(None)
    session.select(caps(both=False), "replace")
    assert len(session.state.selection) == len(caps(both=False))


def test_an_image_has_the_kind_weight_and_slide_of_its_leader_until_it_is_unlinked():
    session = begun(BALL)
    number = added(session, caps(both=False), "moving")
    partner = session.mirror(number, 0)
    with pytest.raises(InputError, match="follows another group"):
        session.mirror(partner, 0)
    for which, normal in (number, [1, 0.5, 0]), (partner, [-1, 0.5, 0]):
        session.alter(which, slide=Slide.plane(normal), weight=3.0 if which == number else 4.0)
        one, other = session.state.groups
        assert one.weight == other.weight == (3.0 if which == number else 4.0)
        unit = np.array([1, 0.5, 0]) / np.linalg.norm([1, 0.5, 0])
        assert np.allclose(np.abs(one.slide.across @ unit), 1)
        assert np.allclose(np.abs(other.slide.across @ ACROSS @ unit), 1)
    slide = session.state.groups[1].slide
    session.release(number, Motion(np.eye(3), np.array([0, 0.1, 0])))
    assert session.state.groups[1].slide is slide  # a drag need not bind the mesh anew
    session.alter(partner, kind="static")
    assert [group.kind for group in session.state.groups] == ["static", "static"]
    session.undo()
    session.unlink(partner)
    before = session.state.group(partner)
    session.release(number, Motion(np.eye(3), np.array([0, 0.1, 0])))
    assert session.state.group(partner) is before
    session.undo()
    session.undo()
    session.remove(number)
    (left,) = session.state.groups
    assert left.link is None and left.vertices is before.vertices


def test_a_mirrored_group_that_is_saved_repeats_and_continues(monkeypatch):
    session = begun(BALL)
    session.mirror_picks(0)
    number = added(session, caps(both=False), "moving")
    added(session, np.flatnonzero(BALL.V[:, 1] < -0.9), "static")
    settled(session, number, turned(BALL.V, 0.2))
    groups = session.state.groups
    assert_mirrored(groups[0], groups[1])
    session.save("handles", "pose.json")
    session.save("mesh", "posed.ply")
    command = ["deform", "body.ply", "pose.json", "--options", "pose.json", "-o", "again.ply"]
    assert main(command) == 0
    gap = np.abs(read_arrays("again.ply")[0] - read_arrays("posed.ply")[0]).max()
    assert gap < 1e-9
    again = Session(Path("body.ply"), handles=Path("pose.json"))
    assert not again.is_unsaved and again.state.settings == ("fast", True, True)
    session.select(np.array([0]), "replace")  # writes a recovery file only after a change
    session.release(number, Motion(np.eye(3), np.zeros(3)))
    monkeypatch.setattr(recovery, "_is_running", lambda _: False)
    third = Session(Path("body.ply"))
    third.recover(session.recovery.path)
    for other in again, third:
        for one, new in zip(session.state.groups, other.state.groups, strict=True):
            assert np.array_equal(one.vertices, new.vertices) and np.array_equal(one.target, new.target)
            assert (one.link is None) == (new.link is None)
            if one.link is not None:
                assert one.link.axis == new.link.axis
        leader = other.state.groups[0].number
        other.release(leader, Motion(np.eye(3), np.array([0.1, 0, 0])))
        assert_mirrored(*other.state.groups[:2])


@pytest.mark.parametrize("record", [None, 3, [], [None], [None, [5, 0, 0.0]], [None, "x"]])
def test_records_of_links_that_another_program_changed_are_left_out(record):
    session = begun()
    for k in range(2):
        added(session, np.arange(20 * k, 20 * k + 20), "moving")
    session.save("handles", "pose.json")
    data = json.loads(Path("pose.json").read_text())
    Path("pose.json").write_text(json.dumps({**data, "links": record}))
    again = Session(Path("body.ply"), handles=Path("pose.json"))
    assert [group.link for group in again.state.groups] == [None, None]


def test_a_mesh_without_symmetry_has_no_images():
    session = begun(beside(BODY, shifted(icosphere(1), [5, 4, 0])))
    number = added(session, np.arange(BODY.n, BODY.n + 5), "moving")
    with pytest.raises(InputError, match="no vertices on the other side"):
        session.mirror(number, 0)


def test_a_limit_spares_the_surroundings_of_the_image_too():
    session = begun(BALL)
    session.mirror_picks(0)
    number = added(session, caps(both=False), "moving")
    session.limit(number, 0.3)
    one, other, fixed = session.state.groups
    away = along_edges(BALL, np.concatenate([one.vertices, other.vertices]))
    assert (away[fixed.vertices] > 0.3).all() and len(fixed.vertices) > 100

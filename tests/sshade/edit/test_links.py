"""Groups that follow other groups: mirror images and surroundings."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sshade import InputError, Slide
from sshade.cli.main import main
from sshade.edit import recovery
from sshade.edit.groups import Motion
from sshade.edit.links import SOFT
from sshade.edit.session import Session
from sshade.edit.state import Settings
from sshade.io.meshes import read_arrays
from tests.shapes import beside, bumpy, icosphere, shifted
from tests.sshade.edit.sessions import BODY, added, along_edges, begun, settled, tip, turned

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


@pytest.mark.parametrize("turns", [False, True])
def test_surroundings_make_a_part_of_the_motion_that_falls_off_with_the_distance(turns):
    session = begun(bumpy(4))
    V = session.mesh.V
    number = tip(session)
    ring = session.fade(number, 1.2)
    core, around = (session.state.group(which) for which in (number, ring))
    away = along_edges(session.mesh, core.vertices)
    assert around.vertices.tolist() == np.flatnonzero((away > 0) & (away < 1.2)).tolist()
    assert session.state.settings == ("fast", False, False) and around.weight == SOFT
    turn = Rotation.from_rotvec([0, 0, 0.8] if turns else [0, 0, 0])
    centre = V[core.vertices].mean(axis=0)
    move = np.array([0.1, 0.05, 0.3])
    session.release(number, Motion.about(centre, turn.as_quat(), move))
    around = session.state.group(ring)
    t = 1 - away[around.vertices] / 1.2
    part = 3 * t**2 - 2 * t**3
    for vertex, target, f in zip(around.vertices, around.target, part, strict=True):
        partly = Rotation.from_rotvec(f * turn.as_rotvec()).apply(V[vertex] - centre) + centre + f * move
        assert np.allclose(target, partly, atol=1e-9)
    session.settle()
    moved = np.linalg.norm(session.shown - V, axis=1)
    gap = np.linalg.norm(session.shown[around.vertices] - around.target, axis=1)
    assert gap.mean() < 0.1 * np.linalg.norm(move)  # 0.03 with four times the vertices
    assert moved[away > 1.2].mean() < 0.05 * np.linalg.norm(move)
    with pytest.raises(InputError, match=f"follows {core.name}; move {core.name}"):
        session.release(ring, Motion(np.eye(3), move))
    again = session.fade(number, 0.8)  # replaces the surroundings
    assert len(session.state.groups) == 2 and len(session.state.group(again).vertices) < len(around.vertices)
    session.restore(number)
    beyond = session.limit(number, 0.8)
    settled(session, number, Motion(np.eye(3), 0.1 * move))
    fixed = session.state.group(beyond).vertices
    assert fixed.tolist() == np.flatnonzero(away > 0.8).tolist()
    assert np.array_equal(session.shown[fixed], V[fixed])
    session.remove(number)
    assert [group.number for group in session.state.groups] == [beyond]


@pytest.mark.parametrize("ends", ["remove", "unlink"])
def test_without_the_last_falloff_the_settings_before_the_first_come_back(ends):
    session = begun(BALL)
    number = added(session, caps(both=False), "moving")
    session.set_up(Settings("fine", volume=True, area=False))
    session.fade(number, 1.0)
    ring = session.fade(number, 0.8)  # replaces the surroundings
    assert session.state.settings == Settings("fine", volume=False, area=False)
    getattr(session, ends)(ring)
    assert session.state.settings == Settings("fine", volume=True, area=False)
    session.undo()
    assert session.state.settings == Settings("fine", volume=False, area=False)
    session.set_up(Settings("fast", volume=False, area=True))  # a choice of the user stands
    getattr(session, ends)(ring)
    assert session.state.settings == Settings("fast", volume=False, area=True)


def test_a_mirrored_group_fades_on_both_sides_and_what_is_saved_repeats_and_continues(monkeypatch):
    session = begun(BALL)
    session.mirror_picks(0)
    number = added(session, caps(both=False), "moving")
    with pytest.raises(InputError, match="no free vertex is nearer than 0.01"):
        session.fade(number, 0.01)
    session.fade(number, 0.8)
    added(session, np.flatnonzero(BALL.V[:, 1] < -0.9), "static")
    settled(session, number, turned(BALL.V, 0.2))
    groups = session.state.groups
    assert [group.fades for group in groups] == [False, False, True, True, False]
    assert_mirrored(groups[0], groups[1])
    assert_mirrored(groups[2], groups[3])
    session.save("handles", "pose.json")
    session.save("mesh", "posed.ply")
    command = ["deform", "body.ply", "pose.json", "--options", "pose.json", "-o", "again.ply"]
    assert main(command) == 0
    gap = np.abs(read_arrays("again.ply")[0] - read_arrays("posed.ply")[0]).max()
    assert gap < 1e-9
    again = Session(Path("body.ply"), handles=Path("pose.json"))
    assert not again.is_unsaved and again.state.settings == ("fast", False, False)
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
                assert one.link.axis == new.link.axis and one.fades == new.fades
                if one.fades:
                    assert np.allclose(one.link.influence, new.link.influence, atol=1e-12)
        leader = other.state.groups[0].number
        other.release(leader, Motion(np.eye(3), np.array([0.1, 0, 0])))
        assert_mirrored(*other.state.groups[:2])
        assert_mirrored(*other.state.groups[2:4])


@pytest.mark.parametrize(
    "record", [None, 3, [], [None], [[0, None, 1]] * 3, [None, [5, 0, 0.0]], [None, "x"]]
)
def test_records_of_links_that_another_program_changed_are_left_out(record):
    session = begun()
    for k in range(2):
        added(session, np.arange(20 * k, 20 * k + 20), "moving")
    session.save("handles", "pose.json")
    data = json.loads(Path("pose.json").read_text())
    Path("pose.json").write_text(json.dumps({**data, "links": record}))
    again = Session(Path("body.ply"), handles=Path("pose.json"))
    assert [group.link for group in again.state.groups] == [None, None]


def test_vertices_that_another_group_takes_leave_a_follower_with_their_parts():
    session = begun(BODY)
    number = tip(session)
    ring = session.fade(number, 1.2)
    around = session.state.group(ring)
    taken = around.vertices[::2]
    added(session, taken, "static")
    left = session.state.group(ring)
    assert left.vertices.tolist() == around.vertices[1::2].tolist()
    assert np.array_equal(left.link.influence, around.link.influence[1::2])
    session.release(number, turned(BODY.V, 0.1))


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


@pytest.mark.parametrize("loses", [False, True])
def test_followers_of_a_single_vertex_are_where_they_were_when_a_file_is_opened_again(loses):
    session = begun(BODY)
    added(session, np.flatnonzero(BODY.V[:, 2] < -0.8), "static")
    top = int(BODY.V[:, 2].argmax())
    near = np.flatnonzero(np.linalg.norm(BODY.V - BODY.V[top], axis=1) < 0.3)
    number = added(session, near if loses else np.array([top]), "moving")
    session.fade(number, 0.8)
    turn = Rotation.from_rotvec([1, 0, 0]).as_quat()
    session.release(number, Motion.about(BODY.V[top], turn, [0, 0.2, 0.3]))
    if loses:
        added(session, near[:5], "moving")
    session.settle()
    session.save("handles", "pose.json")
    again = Session(Path("body.ply"), handles=Path("pose.json"))
    again.settle()
    assert np.abs(again.shown - session.shown).max() < 1e-9
    fading = [group for group in again.state.groups if group.fades]
    assert len(fading) == (0 if loses else 1)

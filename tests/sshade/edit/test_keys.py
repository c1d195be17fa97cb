"""An animation of a session: keys, poses in between, and the file that `sshade deform` runs."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sshade import InputError, Slide
from sshade.cli.main import main
from sshade.edit import recovery
from sshade.edit.groups import Motion
from sshade.edit.session import Session
from sshade.io.meshes import read_arrays
from sshade.io.poses import read_poses
from sshade.mesh.surface import surface
from tests.sshade.edit.sessions import BODY, added, begun, ready

pytestmark = pytest.mark.usefixtures("here")

TURN = Rotation.from_rotvec([0.2, 0.9, -0.4])
MOVE = np.array([0.3, -0.1, 0.4])


def animated() -> tuple[Session, int]:
    """Return a session with three keys: at rest at 0 s, turned and moved at 1 s, half back at 3 s."""
    session, number = ready()
    session.key(0.0)
    own = session.state.group(number).vertices
    session.release(number, Motion.about(BODY.V[own].mean(axis=0), TURN.as_quat(), MOVE))
    session.key(1.0)
    session.release(number, Motion(np.eye(3), -0.5 * MOVE))
    session.key(3.0)
    return session, number


def expected(own: np.ndarray, time: float) -> np.ndarray:
    """Return the targets of a group at a time: angle and middle change linearly between keys."""
    part = min(time, 1.0)
    way = part if time <= 1 else 1 - 0.25 * (time - 1)
    centre = BODY.V[own].mean(axis=0)
    return Rotation.from_rotvec(part * TURN.as_rotvec()).apply(BODY.V[own] - centre) + centre + way * MOVE


def test_groups_turn_and_move_evenly_between_keys_and_stay_beyond():
    session, number = animated()
    own = session.state.group(number).vertices
    keyed = {key.time: key.groups for key in session.state.keys}
    for time in 0.0, 0.25, 0.8, 1.0, 1.5, 2.9, 3.0, 7.0:
        session.pose(time)
        moving = session.state.group(number)
        assert np.abs(moving.target - expected(own, min(time, 3.0))).max() < 1e-12
        if time in keyed:
            assert moving.target is keyed[time][1].target
        assert np.array_equal(session.state.groups[0].target, BODY.V[session.state.groups[0].vertices])
    shown = session.seek(0.5)
    assert np.array_equal(shown[own], session.shown[own])
    assert np.abs(shown[own] - expected(own, 0.5)).max() < 1e-12 and np.abs(shown - BODY.V).max() > 0.1
    before = session.state.group(number).target
    session.settle()
    assert np.array_equal(session.shown[own], before)  # `seek` shows a pose without a change


def test_keys_are_replaced_removed_and_undone_and_mistakes_are_told():
    session = begun()
    for call in lambda: session.key(0), lambda: session.seek(0), lambda: session.pose(0):
        with pytest.raises(InputError, match="no groups to animate"):
            call()
    session, number = ready()
    for call in session.seek, session.pose:
        with pytest.raises(InputError, match="store a pose first"):
            call(0.0)
    for wrong in -1.0, 1e4, np.nan:
        with pytest.raises(InputError, match="from 0 to 600"):
            session.key(wrong)
    session.key(2.0)
    session.key(1.0)
    assert [key.time for key in session.state.keys] == [1.0, 2.0]
    session.release(number, Motion(np.eye(3), MOVE))
    shape = session.state
    session.key(1.0)
    assert [key.time for key in session.state.keys] == [1.0, 2.0] and session.state.same_shape(shape)
    assert session.state.keys[0].groups[1].target is session.state.group(number).target
    session.unkey(2.0)
    with pytest.raises(InputError, match="no key at 2 s"):
        session.unkey(2.0)
    session.undo()
    assert len(session.state.keys) == 2 and session.is_unsaved
    with pytest.raises(InputError, match="at most 10,000 frames"):
        session.save("animation", "a.json", rate=1e5)
    with pytest.raises(InputError, match="a number from 0"):
        session.save("animation", "a.json", rate=-1.0)
    assert not Path("a.json").exists()


def test_the_saved_animation_is_run_by_the_command_and_opened_again():
    session, number = animated()
    session.alter(number, name="hand")
    session.alter(session.state.groups[0].number, name="hand")  # frames name groups, so names must differ
    session.settle()
    session.save("animation", "wave.json", rate=2.0)
    assert not session.is_unsaved
    own = session.state.group(number).vertices
    poses = read_poses([Path("wave.json")], fps=1)
    assert poses.times.tolist() == [0, 0.5, 1, 1.5, 2, 2.5, 3]
    for time, handles in zip(poses.times, poses.on(surface(BODY.V, BODY.F)), strict=True):
        rows = np.isin(handles.index, own)
        assert np.abs(handles.target[rows] - expected(own, time)).max() < 1e-12
        assert np.array_equal(handles.target[~rows], BODY.V[handles.index[~rows]])
    line = ["deform", "body.ply", "wave.json", "--options", "wave.json"]
    assert main([*line, "-o", "out_%04d.ply"]) == 0
    last = read_arrays("out_0007.ply")[0]
    assert np.array_equal(last[own], session.state.group(number).target)
    gap = np.linalg.norm(last - session.shown, axis=1).mean()
    assert gap < 0.01 * BODY.diagonal < np.linalg.norm(last - BODY.V, axis=1).mean()
    assert main(session.document.animation_command.split()[1:]) == 0 and Path("body_animated.glb").exists()
    again = Session(Path("body.ply"), handles=Path("wave.json"))
    assert not again.is_unsaved and [key.time for key in again.state.keys] == [0, 1, 3]
    assert [group.name for group in again.state.groups] == ["hand", "hand 2"]
    session.open(Path("wave.json").read_bytes(), "wave.json")
    for other in again, session:
        other.pose(1.5)
        assert np.abs(other.state.groups[1].target - expected(own, 1.5)).max() < 1e-9


def test_animations_of_other_programs_have_a_key_for_each_frame():
    frames = [{"time": 0.5}, {"time": 2, "handles": [{"landmark": "tip", "target": [[0, 0, 3]]}]}]
    handles = [{"landmark": "foot", "vertices": [0, 1]}, {"landmark": "tip", "vertices": [9]}]
    Path("a.json").write_text(json.dumps({"handles": handles, "frames": frames}))
    session = Session(Path("body.ply") if begun() else None, handles=Path("a.json"))
    assert [key.time for key in session.state.keys] == [0.5, 2]
    session.pose(5.0)
    assert session.state.groups[1].target.tolist() == [[0, 0, 3]]
    frames[1]["time"] = 0.1
    content = json.dumps({"handles": handles, "frames": frames}).encode()
    before = session.state
    with pytest.raises(InputError, match=r"b\.json: frame 1: its time 0\.1 is not larger"):
        session.open(content, "b.json")
    assert session.state is before


@pytest.mark.parametrize("kind", ["free", "single", "plane", "image"])
def test_rotations_slides_and_followers_are_in_the_frames(kind, monkeypatch):
    session, number = ready()
    top = int(np.argmax(BODY.V[:, 2])) if kind == "single" else None
    if top is not None:
        number = added(session, np.array([top]), "moving")
    if kind == "free":
        session.alter(number, slide=Slide.anywhere())
    if kind == "plane":
        session.alter(number, slide=Slide.plane([1, 0, 0]))
    if kind == "image":
        number = added(session, np.flatnonzero(BODY.V[:, 0] > 0.9), "moving")
        partner = session.mirror(number, 0)
    session.key(0.0)
    session.release(number, Motion.about(np.zeros(3), TURN.as_quat(), 0.2 * MOVE))
    session.key(2.0)
    session.save("animation", "wave.json", rate=1.0)
    handles = read_poses([Path("wave.json")], fps=1).on(surface(BODY.V, BODY.F))
    half = Rotation.from_rotvec(0.5 * TURN.as_rotvec()).as_matrix()
    own = np.isin(handles[1].index, session.state.group(number).vertices)
    if kind != "image":
        assert np.allclose(handles[1].rotation[own], half, atol=1e-9)
        assert np.allclose(handles[0].rotation[own], np.eye(3))
    else:
        session.pose(1.0)
        assert np.allclose(handles[1].target[own], session.state.group(number).target)
        own = np.isin(handles[1].index, session.state.group(partner).vertices)
        assert np.allclose(handles[1].target[own], session.state.group(partner).target)
        assert np.abs(handles[1].target[own] - BODY.V[handles[1].index[own]]).max() > 0.05
        session.undo()
    monkeypatch.setattr(recovery, "_is_running", lambda _: False)
    session.key(4.0)  # writes a recovery file
    again = Session(Path("body.ply"))
    again.recover()
    assert [key.time for key in again.state.keys] == [0, 2, 4]
    for time in 0.7, 2.0:
        session.pose(time)
        again.pose(time)
        for one, new in zip(session.state.groups, again.state.groups, strict=True):
            assert np.abs(one.target - new.target).max() < 1e-12


def test_a_group_made_after_a_key_is_at_rest_there_and_a_smaller_one_keeps_its_places():
    session, number = animated()
    own = session.state.group(number).vertices
    session.pose(1.0)
    new = added(session, own[::2], "moving")
    session.pose(3.0)
    assert np.array_equal(session.state.group(new).target, BODY.V[own[::2]])
    assert np.abs(session.state.group(number).target - expected(own, 3.0)[1::2]).max() < 1e-12

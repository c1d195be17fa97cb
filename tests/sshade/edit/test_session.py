"""A session without a browser: what is picked, marked, dragged, undone and saved."""

import json
from pathlib import Path

import numpy as np
import pytest

from sshade import InputError, Mesh, Slide
from sshade.cli.main import main
from sshade.edit import follower, state
from sshade.edit import session as editing
from sshade.edit.session import Session, Superseded
from sshade.edit.state import Motion, Settings
from sshade.io.handles import read_handles
from sshade.io.meshes import read_arrays, write_mesh
from tests.shapes import as_obj, beside, bumpy, icosphere, rotation, shifted, strip, torn, torus, tube
from tests.sshade.mesh.test_cutting import t_fin

BODY = bumpy(3)
LIFT = Motion(np.eye(3), np.array([0.0, 0.0, 0.4]))


SHAPES = {
    "a closed body": BODY,
    "two rings": tube(24, 40),
    "a torus": torus(40, 20),
    "a sheet": strip(30, 12),
}


pytestmark = pytest.mark.usefixtures("here")


def begun(mesh: Mesh = BODY, name: str = "body.ply", **given) -> Session:
    write_mesh(name, mesh.V, mesh.F)
    return Session(Path(name), **given)


def ends(V: np.ndarray, share: float = 0.15) -> tuple[np.ndarray, np.ndarray]:
    """The vertices at both ends of the longest extent."""
    x = V[:, np.argmax(np.ptp(V, axis=0))]
    low, high = x.min() + share * np.ptp(x), x.max() - share * np.ptp(x)
    return np.flatnonzero(x < low), np.flatnonzero(x > high)


def marked(session: Session) -> int:
    """One end held, and the other movable; the number of that."""
    held, free = ends(session.mesh.V)
    session.select(held, "replace")
    session.mark("static")
    session.select(free, "replace")
    return session.mark("moving")


def ready(mesh: Mesh = BODY, **given) -> tuple[Session, int]:
    """A session with both ends marked, and the number of the movable one."""
    session = begun(mesh, **given)
    return session, marked(session)


def settled(session: Session, number: int, motion: Motion) -> np.ndarray:
    """The shape at rest after a group is released."""
    session.release(number, motion)
    session.settle()
    return session.shown


def turned(V: np.ndarray, amount: float) -> Motion:
    """A turn of an end about its middle, and a shift, both by a share."""
    _, free = ends(V)
    quaternion = np.array([0.1, 0.2, 0.3, 1 / max(amount, 1e-3)])
    return Motion.about(V[free].mean(axis=0), quaternion, amount * np.array([0.2, 0.3, -0.1]))


@pytest.mark.parametrize("seed", range(3))
def test_ways_to_pick_are_those_of_sets(seed):
    session, rng = begun(), np.random.default_rng(seed)
    a, b = (set(rng.choice(BODY.n, 90, replace=False).tolist()) for _ in range(2))
    beside = [set() for _ in range(BODY.n)]
    for i, j in BODY.edges.tolist():
        beside[i].add(j)
        beside[j].add(i)
    steps = [
        ("replace", a, a),
        ("add", b, a | b),
        ("grow", (), {v for v in range(BODY.n) if v in a | b or beside[v] & (a | b)}),
        ("replace", b, b),
        ("shrink", (), {v for v in b if beside[v] <= b}),
        ("replace", a, a),
        ("remove", b, a - b),
        ("invert", (), set(range(BODY.n)) - (a - b)),
        ("all", (), set(range(BODY.n))),
        ("none", (), set()),
    ]
    for how, given, expected in steps:
        session.select(np.array(list(given), dtype=np.int64), how)
        assert session.state.selection.tolist() == sorted(expected), how


def reached(mesh: Mesh, sources: list[int], distance: float) -> list[int]:
    """Vertices within a distance along edges, by relaxing all edges until nothing changes."""
    found = np.full(mesh.n, np.inf)
    found[sources] = 0
    i, j = mesh.edges.T
    length = np.linalg.norm(mesh.V[i] - mesh.V[j], axis=1)
    for _ in range(mesh.n):
        before = found.copy()
        np.minimum.at(found, j, before[i] + length)
        np.minimum.at(found, i, before[j] + length)
        if np.array_equal(before, found):
            return np.flatnonzero(found <= distance).tolist()
    raise AssertionError


def test_vertices_are_picked_by_connection_and_by_distance_along_edges():
    mesh = beside(BODY, shifted(BODY, [4, 0, 0]))
    session = begun(mesh)
    with pytest.raises(InputError, match="no vertex is picked"):
        session.reach(0.3)
    session.select(np.array([3, 90]), "replace")
    for wrong in 0.0, -1.0, np.nan:
        with pytest.raises(InputError, match="above 0"):
            session.reach(wrong)
    session.reach(0.7)
    assert session.state.selection.tolist() == reached(mesh, [3, 90], 0.7)
    assert 10 < len(session.state.selection) < BODY.n
    session.select(np.zeros(0, dtype=np.int64), "linked")
    assert session.state.selection.tolist() == list(range(BODY.n))


def test_a_limited_group_moves_nothing_beyond_the_distance():
    session = begun()
    session.select(np.array([int(np.argmax(BODY.V[:, 2]))]), "replace")
    session.reach(0.3)
    number = session.mark("moving")
    with pytest.raises(InputError, match="no free vertex is farther than 50"):
        session.limit(number, 50.0)
    number_beyond = session.limit(number, 1.0)
    made = session.state.group(number_beyond)
    own = session.state.group(number).vertices
    near = reached(BODY, own.tolist(), 1.0)
    assert made.kind == "static" and sorted([*made.vertices, *near]) == list(range(BODY.n))
    settled(session, number, Motion(np.eye(3), np.array([0, 0, 0.2])))
    moved = np.linalg.norm(session.shown - BODY.V, axis=1)
    assert moved[made.vertices].max() == 0 and np.allclose(moved[own], 0.2)
    between = np.setdiff1d(near, own)
    assert len(between) and 0.01 < moved[between].mean() < 0.2


@pytest.mark.parametrize("axis", range(3))
def test_a_mirrored_group_makes_a_symmetric_shape(axis):
    ball = icosphere(3)  # symmetric in all coordinate planes
    session = begun(ball)
    S = np.diag(np.where(np.arange(3) == axis, -1.0, 1.0))
    aside = np.eye(3)[axis] + 0.2
    side = ball.V @ (aside / np.linalg.norm(aside))
    session.select(np.flatnonzero(side > 0.9), "replace")
    number = session.mark("moving")
    session.alter(number, slide=Slide.plane(aside), weight=5.0)
    session.release(number, turned(ball.V, 0.3))
    partner = session.mirror(number, axis)
    new = session.state.group(partner)
    group = session.state.group(number)
    for one, other in zip(group.vertices, group.target, strict=True):
        (place,) = np.flatnonzero(np.linalg.norm(ball.V[new.vertices] - ball.V[one] @ S, axis=1) < 1e-9)
        assert np.allclose(new.target[place], other @ S, atol=1e-9)
    assert np.allclose(new.turn, S @ group.turn @ S) and new.weight == 5.0
    assert np.allclose(np.abs(new.slide.across @ S @ group.slide.across.T), 1)
    session.alter(number, slide=None)
    session.release(number, turned(ball.V, 0.1))
    partner = session.mirror(number, axis)  # replaces the mirrored group
    again = session.state.group(partner)
    assert [g.number for g in session.state.groups] == [number, again.number] and again.slide is None
    session.select(np.flatnonzero(np.abs(ball.V[:, axis]) < 1e-9), "replace")
    with pytest.raises(InputError, match="on both sides"):
        session.mirror(session.mark("moving"), axis)


def test_local_axes_have_the_normal_as_z_and_turn_with_the_group():
    session = begun()
    for direction in np.eye(3):
        along = BODY.V @ direction / np.linalg.norm(BODY.V, axis=1)
        for vertices in np.flatnonzero(along > 0.9), np.array([int(np.argmax(along))]):
            session.select(vertices, "replace")
            number = session.mark("moving")
            R = session.frame(number)
            assert np.allclose(R.T @ R, np.eye(3)) and np.linalg.det(R) > 0 and R[:, 2] @ direction > 0.8
            session.release(number, Motion(rotation(5), np.zeros(3)))
            assert np.allclose(session.frame(number), rotation(5) @ R)


def test_what_cannot_be_picked_or_marked_is_told():
    session = begun()
    for vertices, how in ([BODY.n], "add"), ([-1], "add"), ([0], "nearly"):
        with pytest.raises(InputError):
            session.select(np.array(vertices), how)
    with pytest.raises(InputError, match="no vertex is picked"):
        session.mark("moving")
    session.select(np.array([0]), "add")
    with pytest.raises(InputError, match="static or moving"):
        session.mark("loose")
    number = session.mark("static")
    with pytest.raises(InputError, match="is static"):
        session.drag(number, LIFT)
    for call in (session.remove, session.restore, lambda n: session.drag(n, LIFT)):
        with pytest.raises(InputError, match="no group 7"):
            call(7)
    for wrong in {"weight": 0.0}, {"weight": np.nan}, {"name": ""}, {"kind": "soft"}:
        with pytest.raises(InputError):
            session.alter(number, **wrong)
    assert len(session.state.groups) == 1


def test_a_vertex_is_in_the_group_that_took_it_last():
    session = begun()
    session.select(np.arange(10), "replace")
    first = session.mark("static")
    session.select(np.arange(5, 20), "replace")
    second = session.mark("moving")
    assert {g.number: g.vertices.tolist() for g in session.state.groups} == {
        first: list(range(5)),
        second: list(range(5, 20)),
    }
    session.select(np.arange(5), "replace")
    third = session.mark("moving")
    assert [g.number for g in session.state.groups] == [second, third]
    session.remove(second)
    session.alter(third, name="tip", weight=3.0, kind="static")
    (left,) = session.state.groups
    assert (left.name, left.weight, left.kind) == ("tip", 3.0, "static")


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("method", ["fast", "fine", "paper"])
def test_what_is_saved_deforms_to_the_same_file_on_the_command_line(shape, method):
    session, number = ready(SHAPES[shape], settings=Settings(method))
    motion = turned(session.mesh.V, 0.5)
    session.drag(number, turned(session.mesh.V, 0.2))
    session.drag(number, motion)
    session.release(number, motion)
    assert not session.is_converged and session.is_unsaved
    session.settle()
    assert session.is_converged
    assert session.save("handles", "pose.json")[0].name == "pose.json" and not session.is_unsaved
    path, lost = session.save("mesh", "posed.ply")
    assert (
        lost == () and main(["deform", "body.ply", "pose.json", "-o", "again.ply", "--method", method]) == 0
    )
    assert Path("again.ply").read_bytes() == path.read_bytes()
    handles = session.state.handles(session.mesh)
    assert np.array_equal(read_arrays(path)[0][handles.index], handles.target)
    assert np.abs(read_arrays(path)[0] - session.mesh.V).max() > 0.05 * session.mesh.diagonal


@pytest.mark.parametrize("shape", SHAPES)
def test_a_drag_follows_the_group_and_comes_near_the_shape_at_rest(shape):
    session, number = ready(SHAPES[shape])
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


def test_a_group_alone_takes_the_mesh_along_rigidly():
    session = begun()
    session.select(ends(BODY.V)[1], "replace")
    number = session.mark("moving")
    motion = Motion(rotation(3), np.array([0.3, -0.2, 0.1]))
    session.drag(number, Motion(np.eye(3), np.array([0.1, 0.0, 0.0])))
    settled(session, number, motion)
    assert np.abs(session.shown - (BODY.V @ motion.R.T + motion.t)).max() < 1e-4 * BODY.diagonal


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


def test_a_drag_goes_on_from_where_the_group_was_released_and_from_where_undo_brought_it():
    session, number = ready()
    _, free = ends(BODY.V)
    session.release(number, LIFT)
    settled(session, number, LIFT)
    assert np.allclose(session.shown[free], BODY.V[free] + 2 * LIFT.t)
    session.drag(number, LIFT)
    session.undo()
    session.settle()
    shown = session.drag(number, LIFT)
    assert np.abs(shown[free] - BODY.V[free] - 2 * LIFT.t).max() < 0.01 * BODY.diagonal


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


@pytest.mark.parametrize("late", [False, True])
def test_a_result_is_not_shown_if_the_handles_changed_meanwhile(monkeypatch, late):
    """They change while the method computes, or when it has finished."""
    session, number = ready()
    session.release(number, LIFT)
    compute = editing.converged

    def disturbed(*arguments, progress, **options):
        def impatient(*step) -> None:
            session.drag(number, LIFT)
            progress(*step)

        result = compute(*arguments, progress=progress if late else impatient, **options)
        session.drag(number, LIFT)
        return result

    monkeypatch.setattr(editing, "converged", disturbed)
    with pytest.raises(Superseded):
        session.settle()
    assert not session.is_converged
    monkeypatch.setattr(editing, "converged", compute)
    session.settle()
    assert session.is_converged


def test_after_undo_a_drag_begins_as_the_first_one_did():
    shapes = []
    for far in False, True:
        session, number = ready()
        if far:
            session.drag(number, turned(BODY.V, 2.0))
            session.release(number, turned(BODY.V, 2.0))
            session.undo()
        shapes.append(session.drag(number, LIFT))
    assert np.array_equal(*shapes)


def test_of_a_large_group_a_few_vertices_lead_and_all_arrive(monkeypatch):
    session, number = ready()
    full = session.drag(number, LIFT)
    monkeypatch.setattr(follower, "REDUCED", 20)
    session, number = ready()
    session.alter(session.state.groups[0].number, weight=50.0)
    group = session.state.group(number)
    led = session.drag(number, LIFT)
    assert len(group.vertices) > 20 and np.array_equal(led[group.vertices], LIFT(BODY.V[group.vertices]))
    assert np.linalg.norm(led - full, axis=1).mean() < 0.03 * BODY.diagonal


def test_groups_marked_on_a_deformed_shape_stay_where_they_are():
    session, number = ready()
    before = settled(session, number, LIFT)
    middle = np.flatnonzero(np.abs(BODY.V[:, 2]) < 0.1)
    session.select(middle, "replace")
    session.mark("static")
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
    session.undo()
    assert session.shown is shape and session.state.group(number).name == "tip"


def test_saved_groups_are_opened_as_they_were():
    session, number = ready()
    session.alter(number, name="top", weight=7.5)
    session.select(np.array([300]), "replace")
    tip = session.mark("moving")
    session.release(tip, Motion(rotation(1), np.zeros(3)))
    session.release(number, LIFT)
    session.save("handles", "pose.json")
    again = Session(Path("body.ply"), handles=Path("pose.json"))
    assert not again.history.can_undo and not again.is_unsaved and not again.is_converged
    session.open(Path("pose.json").read_bytes(), "pose.json")
    for other in again, session:
        for group, new in zip(session.state.groups, other.state.groups, strict=True):
            assert (group.name, group.kind, group.weight) == (new.name, new.kind, new.weight)
            assert np.array_equal(group.vertices, new.vertices)
            assert np.array_equal(group.target, new.target)
    assert session.state.groups[1].name == "top"
    # Where a vertex goes does not say how it turns; where a region goes does.
    assert [group.rotation is not None for group in again.state.groups] == [False, False, True]
    assert np.allclose(again.state.groups[2].rotation, rotation(1))


def test_free_constraints_change_the_shape_and_are_written_down():
    session, number = ready()
    settled(session, number, turned(BODY.V, 0.8))
    kept, shape = Mesh(session.shown, BODY.F).volume, session.shown
    session.set_up(Settings(volume=False))
    session.settle()
    assert abs(kept / BODY.volume - 1) < 1e-3 < abs(Mesh(session.shown, BODY.F).volume / BODY.volume - 1)
    made = json.loads(session.save("handles", "free.json")[0].read_text())["made"]
    assert made == {"method": "fast", "volume": 0.0}
    session.undo()
    assert session.shown is shape


#: Where groups are on the body, as a direction from its middle, and how they move.
SWITCHED = {
    "fixed": ([0, 0, -1], {"kind": "static"}),
    "turned": ([0, 0, 1], {}),
    "soft": ([0, 1, 0], {"weight": 4.0}),
    "plane": ([0, -1, 0], {"slide": Slide.plane([0.1, 1, 0]), "kind": "static"}),
    "line": ([1, 0, 0.2], {"slide": Slide.line([0, 1, 1]), "weight": 30.0}),
    "axes": ([-1, 0.2, 0], {"slide": Slide.axes("xz")}),
    "rest": ([-1, -1, 1], {"slide": Slide.on(BODY, name="rest")}),
    "free": ([1, 1, 1], {"slide": Slide.anywhere()}),
}


def switched(*, single: bool) -> Session:
    """A session on a body and a copy that follows, with a group of every kind: `single` vertices or caps."""
    V, F, _ = torn(BODY)
    V[BODY.n + 1 :] += 3e-7  # a seam that opened
    pair = beside(Mesh(V[1:], F - 1), shifted(BODY, [4, 0, 0]))
    session = begun(pair, carry_unconstrained=True, weld=1e-6, repair=True)
    assert session.mesh.n == 2 * BODY.n < pair.n
    unit = BODY.V / np.linalg.norm(BODY.V, axis=1)[:, None]
    for name, (direction, fields) in SWITCHED.items():
        near = unit @ (np.array(direction) / np.linalg.norm(direction))
        session.select(np.flatnonzero(near >= (near.max() if single else 0.95)), "replace")
        number = session.mark("moving")
        if name != "fixed":
            session.release(number, turned(BODY.V, 0.2 if name in ("turned", "free") else 0.05))
        session.alter(number, name=name, **fields)
    return session


@pytest.mark.parametrize("single", [True, False])
@pytest.mark.parametrize("method", ["fast", "fine", "paper"])
def test_one_command_repeats_a_session_in_which_everything_was_switched(method, single):
    session = switched(single=single)
    session.set_up(Settings(method, volume=False, area=False))
    session.settle()
    assert session.is_unsaved and session.save("handles", "body_handles.json") and not session.is_unsaved
    posed = session.shown
    assert main(session.document.command.split()[1:]) == 0
    again = read_arrays("body_deformed.ply")[0]
    session.save("mesh", "posed.ply")
    expected = read_arrays("posed.ply")[0]
    assert np.abs(again - expected).max() < 1e-6 * BODY.diagonal
    assert np.abs(posed - session.mesh.V)[: BODY.n].max() > 0.05
    opened = Session(Path("body.ply"), handles=Path("body_handles.json"), weld=1e-6, repair=True)
    for one, new in zip(session.state.groups, opened.state.groups, strict=True):
        assert (one.slide is None) == (new.slide is None) and one.weight == new.weight
        assert one.slide is None or one.slide.record == new.slide.record
    if method != "fine":
        handles = session.state.handles(session.mesh)
        number = session.state.groups[1].number
        for step in 0.02, 0.04:
            shown = session.drag(number, turned(BODY.V, step))
        at = np.flatnonzero(handles.exact & handles.slides)
        gap = np.linalg.norm(shown[handles.index] - handles.goals(shown), axis=1)[at]
        assert len(at) and gap.max() < 1e-9 * BODY.diagonal


def test_a_group_slides_from_where_it_is_and_stays_where_it_slid():
    session, number = ready()
    top = int(np.argmax(BODY.V[:, 2]))
    session.select(np.array([top]), "replace")
    tip = session.mark("moving")
    session.alter(tip, slide=Slide.plane(session.normal(tip)))
    settled(session, number, LIFT)
    there = session.shown[top]
    assert np.linalg.norm(there - BODY.V[top]) > 0.01
    session.alter(tip, slide=None)
    session.settle()
    assert np.allclose(session.shown[top], there, rtol=0, atol=1e-12)


def test_of_two_components_the_one_that_is_dragged_follows_at_once():
    mesh = beside(BODY, shifted(BODY, [4, 0, 0]))
    session = begun(mesh, carry_unconstrained=True)
    left = np.flatnonzero(mesh.V[:, 0] < 2)
    session.select(left[mesh.V[left, 2] < -0.6], "replace")
    session.mark("static")
    session.select(left[mesh.V[left, 2] > 0.6], "replace")
    number = session.mark("moving")
    shown = session.drag(number, LIFT)
    moved = np.abs(shown - mesh.V).max(axis=1)
    free = np.setdiff1d(left, np.concatenate([group.vertices for group in session.state.groups]))
    assert (moved[free] > 1e-4).mean() > 0.9 and moved[BODY.n :].max() == 0
    settled(session, number, LIFT)
    assert np.abs(session.shown - mesh.V)[BODY.n :].max() > 1e-3
    assert session.save("handles", "pose.json") and session.save("mesh", "posed.ply")
    arguments = ["deform", "body.ply", "pose.json", "-o", "again.ply", "--carry-unconstrained"]
    assert main(arguments) == 0 and Path("again.ply").read_bytes() == Path("posed.ply").read_bytes()


def test_a_mesh_that_is_no_manifold_follows_when_the_mouse_rests():
    mesh = t_fin(4)
    session = begun(mesh)
    x = mesh.V[:, 0]
    session.select(np.flatnonzero(x <= x.min() + 1), "replace")
    session.mark("static")
    session.select(np.flatnonzero(x >= x.max() - 1), "replace")
    number = session.mark("moving")
    own = session.state.group(number).vertices
    shown = session.drag(number, LIFT)
    assert np.flatnonzero(np.abs(shown - mesh.V).max(axis=1)).tolist() == own.tolist()
    settled(session, number, LIFT)
    assert np.count_nonzero(np.abs(session.shown - mesh.V).max(axis=1) > 1e-6) > 2 * len(own)


def test_large_meshes_take_other_handles_without_being_bound_anew(monkeypatch):
    bound = []
    deformer = follower.Deformer
    monkeypatch.setattr(follower, "Deformer", lambda *a, **k: bound.append(1) or deformer(*a, **k))
    body = bumpy(5)
    for limit, count in (0, 1), (body.n + 1, 2):
        monkeypatch.setattr(follower, "REBOUND", limit)
        session = begun(body)
        monkeypatch.setattr(session._follower, "prepare", lambda *_: None)
        bound.clear()
        number = marked(session)
        session.drag(number, LIFT)
        session.select(np.flatnonzero(np.abs(body.V[:, 2]) < 0.1), "replace")
        session.mark("static")
        shown = session.drag(number, LIFT)
        target = session.state.moved(number, LIFT).group(number)
        assert np.abs(shown[target.vertices] - target.target).max() < 0.01 * body.diagonal
        assert len(bound) == count


def test_texture_coordinates_and_doubled_vertices_stay_in_the_saved_file():
    V, F, seam = torn(strip(20, 8))  # no vertex has the number that it has on the surface
    Path("sheet.obj").write_text(as_obj(V, F))
    session = Session(Path("sheet.obj"))
    number = marked(session)
    session.release(number, Motion(np.eye(3), np.array([0, 0, 3.0])))
    path, _ = session.save("mesh", "lifted.obj")
    assert path.read_text().partition("vt ")[2] == Path("sheet.obj").read_text().partition("vt ")[2]
    moved, faces = read_arrays(path)
    assert np.array_equal(faces, F) and np.array_equal(moved[0], V[0])
    assert np.array_equal(moved[-len(seam) :], moved[seam])
    session.save("handles", "pose.json")
    assert main(["deform", "sheet.obj", "pose.json", "-o", "again.obj"]) == 0
    assert Path("again.obj").read_bytes() == path.read_bytes()
    assert session.save("mesh", "plain.ply")[1] != ()  # what PLY does not hold is told


def test_only_files_beside_the_mesh_or_named_in_advance_are_written(here):
    (here / "out").mkdir()
    (here / "other.json").write_text("mine")
    session = begun(output=here / "out" / "posed.obj", handles_output=Path("pose.json"))
    marked(session)
    names = ["../pose.json", "/tmp/pose.json", "a/b.json", "a\\b.json", "c:x.json", ".hidden.json", "", ".."]
    for name in [*names, ".", "x.txt", "pose", "a\0.json", "a\n.json", "x" * 200 + ".json"]:
        with pytest.raises(InputError):
            session.save("handles", name, over=True)
    with pytest.raises(InputError, match="exists already"):
        session.save("handles", "other.json")
    assert (here / "other.json").read_text() == "mine"
    session.save("handles", "other.json", over=True)
    session.save("handles", "other.json")  # it is the editor's own now
    assert read_handles("other.json", BODY).index.size
    assert session.save("mesh", "posed.obj")[0] == here / "out" / "posed.obj"
    command = session.document.command
    assert "out/posed.obj" in command and "other.json --options other.json" in command
    plain = begun()
    with pytest.raises(InputError, match="is the mesh"):
        plain.save("mesh", "body.ply", over=True)
    for wrong in {"output": "body.ply"}, {"output": "no/out.ply"}, {"handles_output": "a.ply"}:
        with pytest.raises(InputError):
            begun(**{name: Path(path) for name, path in wrong.items()})

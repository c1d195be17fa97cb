"""Handle files: what each kind of entry means, one table of refusals, and what is written reads back."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sshade import Handles, InputError, Mesh, read_handles
from sshade.files.meshes import write_mesh
from sshade.files.task_files import read_task, write_handles
from sshade.mesh.rigid import rigid_motion
from tests.shapes import bumpy, rotation, shifted, torn


def put(*entries) -> Path:
    """Write entries of handles as pose.json."""
    Path("pose.json").write_text(json.dumps({"handles": entries}))
    return Path("pose.json")


def placed(mesh: Mesh, *entries, **options) -> Handles:
    """Write entries of handles, and place them on a mesh."""
    return read_handles(put(*entries), mesh, **options)


def test_groups_of_every_kind_move_rigidly_and_a_missing_part_is_the_identity(here, body):
    R, t, some, V = rotation(4), [1.0, 2.0, 3.0], [5, 6, 7, 6], body.V
    turn = {"rotation": R.tolist(), "kind": "dynamic"}
    for place, ids in (
        ({"vertices": some}, [5, 6, 7]),
        ({"source": (V[some] + 1e-3).tolist()}, [5, 6, 7]),
        ({"boxes": [[(V[5] - 1e-9).tolist(), (V[5] + 1e-9).tolist()]]}, [5]),
    ):
        at = V[ids]
        mean = at.mean(axis=0)
        for motion, target in (
            ({"translation": t}, at + t),
            (turn, at @ R.T),
            ({**turn, "translation": t}, at @ R.T + t),
            ({**turn, "center": "centroid", "translation": t}, (at - mean) @ R.T + mean + t),
            ({"scale": 2}, 2 * at),
            ({**turn, "rotation": Rotation.from_matrix(R).as_quat().tolist()}, at @ R.T),
            ({"scale": 3, "center": [1, 2, 3], "translation": t}, 3 * (at - [1, 2, 3]) + [1, 2, 3] + t),
        ):
            handles = placed(body, {**place, **motion})
            assert handles.index.tolist() == ids and handles.dynamic.all() and handles.rotation is None
            assert np.allclose(handles.target, target, rtol=0, atol=1e-14), motion
            still = placed(body, {**place, **motion, "kind": "static"})
            assert np.array_equal(still.target, at) and not still.dynamic.any()


@pytest.mark.parametrize("weld", [None, 0])
def test_the_centroid_does_not_depend_on_seams(here, body, weld):
    """Copies along a seam count once: as one vertex of the surface, or as places that are equal."""
    V, F, _ = torn(body)
    write_mesh("torn.ply", V, F)
    own = np.intersect1d(np.flatnonzero(V[:, 0] > 0), F)
    places = np.unique(V[own], axis=0)
    assert len(places) < len(own)
    center, R = places.mean(axis=0), rotation(4)
    entry = {"rotation": R.tolist(), "kind": "moved", "center": "centroid"}
    for place in ({"vertices": own.tolist()}, {"source": V[own].tolist()}):
        task = read_task("torn.ply", handles=str(put({**entry, **place})), weld=weld)
        at = task.mesh.V[task.handles.index]
        assert np.allclose(task.handles.target, (at - center) @ R.T + center, rtol=0, atol=1e-12)


BOX = {"boxes": [[[-9, -9, -9], [9, 9, 9]]]}
TURN = np.eye(3).tolist()


HUGE = 10**400
ODD = [None, True, "1", "", [], {}, [[]], [[[]]], [None], [True], ["1"], [[1, "2", 3]], [[1, 2]], -1, HUGE]
ODD += [float("nan"), [float("inf")], [HUGE], [[HUGE, 0, 0]], [[0, 0, HUGE]] * 3]
VALID = [
    {"vertices": [1], "target": [[0, 0, 0]], "weight": 2},
    {"source": bumpy(3).V[:1].tolist(), "target": [[0, 0, 0]], "rotation": TURN},
    {**BOX, "kind": "dynamic", "scale": 2, "translation": [0, 0, 0], "center": "centroid"},
]


@pytest.mark.parametrize("entry", VALID)
def test_odd_values_are_refused_in_one_sentence(here, body, entry):
    assert len(placed(body, entry)) > 0
    for key in entry:
        for value in ODD:
            with pytest.raises(InputError, match="entry 0: ") as found:
                placed(body, {**entry, key: value})
            message = str(found.value)
            assert "\n" not in message and len(message) < 300, (key, value)


def test_targets_of_copies_may_differ_as_far_from_the_origin_as_single_precision_does(here):
    V, F, seam = torn(shifted(bumpy(2), [100, -3, 1]))
    V = V.astype(np.float32)
    V[-len(seam) :] = np.nextafter(V[-len(seam) :], np.float32(200))
    write_mesh("far.glb", V, F)  # in single precision
    at = np.concatenate([seam[:3], np.arange(len(V) - len(seam), len(V))[:3]])
    for gap, words in (0, None), (1e-4, "contradictory targets"):
        target = V[at] + np.array([0, 0, 0.125])
        target[5] += gap
        path = str(put({"vertices": at.tolist(), "target": target.tolist()}))
        if words is None:
            assert len(read_task("far.glb", handles=path).handles) == 3
        else:
            with pytest.raises(InputError, match=words):
                read_task("far.glb", handles=path)


def test_written_handles_read_back_the_same(here, body):
    """Group 5 is soft, the next has a prescribed rotation, and the last has static and dynamic handles."""
    index = np.random.default_rng(3).permutation(body.n)[:8]
    group = np.array([5, 5, 2**60, 2**60, 2**60, 2**60 + 1, 2**60 + 1, 2**60 + 1])
    dynamic = np.array([1, 1, 1, 1, 1, 0, 1, 1], dtype=bool)
    target = body.V[index] + dynamic[:, None] / 3
    turn = np.where((group == 2**60)[:, None, None], rotation(1), np.nan)
    weight = np.where(group == 5, 0.5, np.inf)
    handles = Handles(index, target, dynamic=dynamic, group=group, weight=weight, rotation=turn)
    write_handles("a.json", handles)
    back = read_handles("a.json", body)
    a, b = np.argsort(handles.index), np.argsort(back.index)
    for name in ("index", "target", "dynamic", "weight", "rotation"):
        assert np.array_equal(getattr(handles, name)[a], getattr(back, name)[b], equal_nan=name == "rotation")
    moved = replace(handles, target=handles.target + 0.1)  # also of the static handle
    write_handles("b.json", moved)
    raw = read_handles("b.json", body, raw=True)
    assert np.array_equal(raw.target[np.argsort(raw.index)], moved.target[a])
    # Groups are renumbered. A group with static and dynamic handles becomes two groups.
    assert back.group[b][np.argsort(a)].tolist() == [0, 0, 1, 1, 1, 2, 3, 3]


@pytest.mark.parametrize("amount", [0.0, 0.5, 2.0])
def test_an_amount_moves_handles_a_part_of_the_way(here, body, amount):
    R, t, rest = rotation(1), np.array([0.3, 0, -0.2]), body.V[[5, 6, 7]]
    rigid = {"rotation": R.tolist(), "translation": t.tolist(), "center": "centroid", "scale": 1.4}
    path = put(
        {"vertices": [5, 6, 7], **rigid},
        {"vertices": [100, 101], "target": (body.V[[100, 101]] + t).tolist(), "rotation": R.tolist()},
        {"source": (body.V[[300, 301]] + 1e-3).tolist(), "target": (body.V[[300, 301]] + 1).tolist()},
    )
    whole, part = read_handles(path, body), read_handles(path, body, amount=amount)
    at = body.V[whole.index]
    assert np.array_equal(part.index, whole.index)
    expected = at + amount * (whole.target - at)
    np.testing.assert_allclose(part.target[3:], expected[3:], rtol=0, atol=1e-15)
    a, b = rest - rest.mean(axis=0), part.target[:3] - part.target[:3].mean(axis=0)
    assert part.target[:3].mean(axis=0) == pytest.approx(rest.mean(axis=0) + amount * t)
    assert np.linalg.norm(b) / np.linalg.norm(a) == pytest.approx(1 + amount * 0.4)
    if amount == 0:
        assert np.array_equal(part.target, at) and part.rotation is None
        return
    angle = np.arccos((np.trace(R) - 1) / 2)  # twice this angle may be more than half a turn
    for turn in (rigid_motion(a, b)[0], part.rotation[part.has_rotation][0]):
        assert np.trace(turn) == pytest.approx(1 + 2 * np.cos(amount * angle))
        assert turn @ R == pytest.approx(R @ turn)

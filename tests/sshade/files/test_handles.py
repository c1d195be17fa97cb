"""Handle files: what each kind of entry means, one table of refusals, and what is written reads back."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sshade import Handles, InputError, Mesh, deform, read_handles
from sshade.files.handle_files import read_handle_file
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


def test_handles_by_position_are_snapped_as_positions_are(here, body):
    foot, hand = body.V[[10, 11]] + 1e-3, body.V[[200, 201, 202]] - 1e-3
    moved = hand @ rotation(1).T + [1, 0, 0]
    entries = [
        {"kind": "static", "source": foot.tolist(), "target": (foot + 1).tolist()},
        {"kind": "dynamic", "source": hand.tolist(), "target": moved.tolist(), "weight": 3},
    ]
    handles = placed(body, *entries)
    still = Handles.from_positions(body, foot, foot, dynamic=False)
    parts = [still, Handles.from_positions(body, hand, moved)]
    for name in ("index", "target", "dynamic"):
        expected = np.concatenate([getattr(part, name) for part in parts])
        assert np.array_equal(getattr(handles, name), expected)
    distances = np.concatenate([part.snapping.distance for part in parts])
    assert np.array_equal(handles.snapping.distance, distances)
    assert handles.weight.tolist() == [np.inf, np.inf, 3, 3, 3]
    assert handles.group.tolist() == [0, 0, 1, 1, 1]
    raw = placed(body, *entries, raw=True)
    assert np.allclose(raw.target, np.concatenate([foot + 1, moved]), rtol=0, atol=1e-15)


def test_a_region_is_all_vertices_in_its_boxes(here, body):
    V = body.V
    low, high = V.min(axis=0), V.max(axis=0)
    boxes = [[low.tolist(), [*high[:2], low[2] + 0.5]], [[high[0] - 0.2, *low[1:]], high.tolist()]]
    inside = (V[:, 2] <= low[2] + 0.5) | (V[:, 0] >= high[0] - 0.2)
    handles = placed(body, {"kind": "static", "boxes": boxes, "translation": [1, 2, 3]}, raw=True)
    assert np.array_equal(handles.index, np.flatnonzero(inside)) and not handles.dynamic.any()
    assert np.array_equal(handles.target, V[inside] + [1, 2, 3])


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


@pytest.mark.parametrize("kind", [{}, {"kind": "static"}])
def test_a_rotation_alone_beside_vertices_prescribes_the_rotation_of_the_surface(here, body, kind):
    R = rotation(4)
    handles = placed(body, {"vertices": [5], "rotation": R.tolist(), **kind})
    assert np.array_equal(handles.rotation, R[None]) and np.array_equal(handles.target, body.V[[5]])


BOX = {"boxes": [[[-9, -9, -9], [9, 9, 9]]]}
TURN = np.eye(3).tolist()
#: An entry of a handle file, and words of its refusal.
ENTRIES = [
    ({"boxes": [[[9, 9, 9], [10, 10, 10]]]}, "entry 0: no vertex lies in its boxes; the mesh spans -"),
    ({"boxes": [[[0, 0, 0], [1, 1, np.nan]]]}, '"boxes" has a NaN or infinite position'),
    ({**BOX, "vertices": [1]}, 'either as "vertices", as "source" or as "boxes"'),
    ({**BOX, "target": [[0, 0, 0]]}, '"boxes" have no "target"'),
    ({**BOX, "kind": "dynamic"}, 'it is dynamic and has no "rotation" or'),
    ({**BOX, "rotation": [[1, 0], [0, 1]]}, '"rotation" must be three rows of three numbers'),
    ({**BOX, "rotation": (-np.eye(3)).tolist()}, "and its determinant be 1"),
    ({**BOX, "rotation": (2 * np.eye(3)).tolist()}, "its rows must have length 1 and be perpendicular, and"),
    ({**BOX, "rotation": [0, 0, 0, 2]}, "a quaternion has length 1, not 2"),
    ({**BOX, "translation": [[0, 0, 0]]}, '"translation" must be three numbers'),
    ({**BOX, "rotation": TURN, "center": "middle"}, '"center" must be .* or "centroid", not "middle"'),
    ({"vertices": [1], "center": [0, 0, 0]}, '"center" needs a "rotation" or a "scale"'),
    ({"name": [], "vertices": [1]}, 'entry 0: "name" must be a name'),
    ({"kind": "free", "vertices": [1]}, "unknown kind 'free'; use fixed, moved or unused"),
    (1, "entry 0: it is no JSON object"),
    ({"vertices": [10**9]}, r"0\.\.\d+, not 1000000000"),
    ({"vertices": [1], "target": [[0, 0, 0]], "translation": [1, 0, 0]}, 'as "target" or as "translation"'),
    ({"vertices": [1, 2], "target": [[0, 0, 0]]}, "2 handles have 1 target; each needs one"),
    ({"kind": "unused", "vertces": [1]}, "no key \"vertces\"; did you mean 'vertices'"),
    ({"vertices": [1], "k\n\ud800" + 999 * "k": 1}, r'no key "k\\n\\ud800k+";'),
]


#: A whole file, and words of its refusal.
DOCUMENTS = [
    (b'{"handles": [{"vertices": [1]}], "handels": 3}', "pose.json: .* \"handels\"; did you mean 'handles'"),
    (b'{"handels": []}', 'pose.json: expected an object with a list "handles"'),
    (b'{"handles": [{"kind": "unused"}]}', "pose.json: there are no handles"),
    (b'{"handles": "\xff\xff"}', "not readable as JSON .it is neither UTF-8 nor UTF-16 text"),
    *((json.dumps({"handles": [entry]}).encode(), words) for entry, words in ENTRIES),
]


@pytest.mark.parametrize(("document", "words"), DOCUMENTS)
def test_a_mistake_is_refused_in_the_words_of_the_file(here, body, document, words):
    Path("pose.json").write_bytes(document)
    with pytest.raises(InputError, match=words):
        read_handles("pose.json", body)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_files_of_other_systems_are_read(here, encoding):
    Path("a.json").write_bytes('{"handles": [{"landmark": "Fu\u00df", "vertices": [7]}]}'.encode(encoding))
    assert read_handle_file("a.json").groups[0].name == "Fu\u00df"


def test_both_vocabularies_are_read(here, body):
    """A file in the words name, fixed and moved equals the file in the words landmark, static and dynamic."""
    for name, fixed, moved in (("name", "fixed", "moved"), ("landmark", "static", "dynamic")):
        handles = placed(
            body,
            {name: "foot", "kind": fixed, "vertices": [1, 2], "translation": [0, 0, 1]},
            {name: "hand", "kind": moved, "vertices": [7, 8], "target": [[0, 0, 1], [0, 1, 1]]},
        )
        assert [group.name for group in read_handle_file("pose.json").groups] == ["foot", "hand"]
        assert handles.dynamic.tolist() == [False] * 2 + [True] * 2
        assert np.array_equal(handles.target, [*body.V[[1, 2]], [0, 0, 1], [0, 1, 1]])


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


@pytest.mark.parametrize("groups", [1, 2])
@pytest.mark.parametrize("by", ["vertices", "source"])
def test_targets_of_one_vertex_may_differ_by_a_millionth_of_the_diagonal(here, body, by, groups):
    at = body.V[5]
    place = [5, 5] if by == "vertices" else [at.tolist()] * 2

    def read(gap: float) -> Handles:
        target = [at.tolist(), (at + [gap * body.diagonal, 0, 0]).tolist()]
        return placed(body, *({by: place[i::groups], "target": target[i::groups]} for i in range(groups)))

    assert len(read(9e-7)) == 1
    with pytest.raises(InputError, match="contradictory targets"):
        read(2.2e-6)


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


def test_unused_groups_are_skipped_and_group_numbers_count_entries(here, body):
    unused = {"kind": "unused", "vertices": [10**9], "source": "nonsense"}
    handles = placed(body, unused, {"kind": "static", "vertices": [4]})
    assert handles.index.tolist() == [4] and handles.group.tolist() == [1]


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


def test_a_task_is_made_of_what_of_a_file_is_a_surface(here):
    """The file has an unused first vertex, a face that repeats a vertex, and a body without handles."""
    body = bumpy(1)
    V = np.concatenate([[[9.0, 9, 9]], body.V, body.V + 5])
    F = np.concatenate([body.F + 1, [[1, 1, 2]], body.F + 1 + body.n])
    write_mesh("bodies.ply", V, F)
    write_handles("pose.json", Handles([1, 5], V[[1, 5]]))
    task = read_task("bodies.ply", handles="pose.json")
    assert np.array_equal(task.mesh.V, V[1:]) and task.handles.index.tolist() == [0, 4]
    result = deform(task, vertices=30)
    assert result.facts.unconstrained == 1 and np.abs(result.vertices - V[1:]).max() < 1e-6
    for vertex, words in (0, "entry 0: vertex 0 belongs to no face"), (85, r"must lie in 0\.\.84, not 85"):
        with pytest.raises(InputError, match=words):
            read_task("bodies.ply", handles=str(put({"vertices": [1, vertex]})))


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


@pytest.mark.parametrize(
    ("amount", "words"),
    [(-0.1, "from 0 to 2, not"), (np.nan, "from 0 to 2, not"), (2, "the scale 0.4 cannot be exceeded 2")],
)
def test_an_amount_out_of_range_is_refused(here, body, amount, words):
    with pytest.raises(InputError, match=words):
        placed(body, {"vertices": [0], "scale": 0.4}, amount=amount)

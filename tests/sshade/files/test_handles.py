"""Handle files: what each kind of entry means, one table of refusals, and what is written reads back."""

import json
from pathlib import Path

import numpy as np
import pytest

from sshade import Handles, InputError, deform
from sshade.cli.notes import handle_notes
from sshade.files.door import on_mesh
from sshade.files.handle_files import read_handle_file
from sshade.files.meshes import write_mesh
from sshade.files.task_files import read_handles, read_task, write_handles
from sshade.mesh.rigid import rigid_motion
from sshade.mesh.surface import surface
from tests.shapes import bumpy, rotation, shifted, tetrahedron, torn


def put(content) -> Path:
    """Write entries of handles, or a whole document, as pose.json."""
    document = content if isinstance(content, dict) else {"handles": content}
    Path("pose.json").write_text(json.dumps(document))
    return Path("pose.json")


def test_handles_by_position_are_snapped_as_positions_are(here, body):
    rng = np.random.default_rng(0)
    foot = body.V[[10, 11]] + 1e-3
    hand = body.V[[200, 201, 202]] + rng.normal(scale=1e-3, size=(3, 3))
    moved = hand @ rotation(1).T + [1, 0, 0]
    entries = [
        {"kind": "static", "source": foot.tolist(), "target": (foot + 1).tolist()},
        {"kind": "dynamic", "source": hand.tolist(), "target": moved.tolist(), "weight": 3},
    ]
    handles = read_handles(put(entries), body)
    assert handles.weight.tolist() == [np.inf, np.inf, 3, 3, 3]
    parts = [
        Handles.from_positions(body, foot, foot, dynamic=False),
        Handles.from_positions(body, hand, moved),
    ]
    assert np.array_equal(handles.index, np.concatenate([part.index for part in parts]))
    assert np.array_equal(handles.target, np.concatenate([part.target for part in parts]))
    assert np.array_equal(handles.snap_distance, np.concatenate([part.snap_distance for part in parts]))
    assert handles.group.tolist() == [0, 0, 1, 1, 1]

    raw = read_handles(put(entries), body, raw=True)
    assert np.allclose(raw.target, np.concatenate([foot + 1, moved]), rtol=0, atol=1e-15)


def test_static_handles_ignore_a_target_unless_raw(here, body):
    entries = [{"kind": "static", "vertices": [5], "target": [[9, 9, 9]]}]
    assert np.array_equal(read_handles(put(entries), body).target, body.V[[5]])
    assert read_handles(put(entries), body, raw=True).target.tolist() == [[9, 9, 9]]


def test_a_region_is_all_vertices_in_its_boxes(here, body):
    V = body.V
    low, high = V.min(axis=0), V.max(axis=0)
    bottom = [low.tolist(), [*high[:2], low[2] + 0.5]]
    side = [[high[0] - 0.2, *low[1:]], high.tolist()]
    R, t = rotation(2), [1.0, 2.0, 3.0]
    entry = {"kind": "static", "boxes": [bottom, side], "rotation": R.tolist(), "translation": t}
    inside = (V[:, 2] <= low[2] + 0.5) | (V[:, 0] >= high[0] - 0.2)
    for raw in (False, True):
        handles = read_handles(put([entry]), body, raw=raw)
        assert np.array_equal(handles.index, np.flatnonzero(inside)) and not handles.dynamic.any()
        target = V[inside] @ R.T + t if raw else V[inside]
        assert np.allclose(handles.target, target, rtol=0, atol=1e-14)


def test_groups_of_every_kind_move_rigidly_and_a_missing_part_is_the_identity(here, body):
    R, t, some = rotation(4), [1.0, 2.0, 3.0], [5, 6, 7, 6]
    turn = {"rotation": R.tolist(), "kind": "dynamic"}
    V = body.V
    box = [(V[5] - 1e-9).tolist(), (V[5] + 1e-9).tolist()]
    for place, ids in (
        ({"vertices": some}, [5, 6, 7]),
        ({"source": (V[some] + 1e-3).tolist()}, [5, 6, 7]),
        ({"boxes": [box]}, [5]),
    ):
        at = V[ids]
        mean = at.mean(axis=0)
        for motion, target in (
            ({"translation": t}, at + t),
            (turn, at @ R.T),
            ({**turn, "translation": t}, at @ R.T + t),
            ({**turn, "center": t}, (at - t) @ R.T + t),
            ({**turn, "center": "centroid", "translation": t}, (at - mean) @ R.T + mean + t),
            ({"scale": 2}, 2 * at),
            ({**turn, "scale": 1.5, "center": "centroid"}, 1.5 * (at - mean) @ R.T + mean),
            ({"scale": 3, "center": [1, 2, 3], "translation": t}, 3 * (at - [1, 2, 3]) + [1, 2, 3] + t),
        ):
            handles = read_handles(put([{**place, **motion}]), body)
            assert handles.index.tolist() == ids and handles.dynamic.all() and handles.rotation is None
            assert np.allclose(handles.target, target, rtol=0, atol=1e-14), motion
            still = read_handles(put([{**place, **motion, "kind": "static"}]), body)
            assert np.array_equal(still.target, at) and not still.dynamic.any()
        moved = read_handles(put([{**place, "translation": t}]), body)
        assert np.array_equal(moved.target, at + t)  # exact


@pytest.mark.parametrize("weld", [None, 0])
def test_the_centroid_does_not_depend_on_seams(here, body, weld):
    """Copies along a seam count once: as one vertex of the surface, or as places that are equal."""
    V, F, seam = torn(body)
    write_mesh("torn.ply", V, F)
    own = np.intersect1d(np.flatnonzero(V[:, 0] > 0), F)
    places = np.unique(V[own], axis=0)
    assert len(np.intersect1d(own, seam)) and len(places) < len(own)
    center, R = places.mean(axis=0), rotation(4)
    entry = {"rotation": R.tolist(), "kind": "moved", "center": "centroid"}
    for place in ({"vertices": own.tolist()}, {"source": V[own].tolist()}):
        task = read_task("torn.ply", handles=str(put([{**entry, **place}])), weld=weld)
        at = task.mesh.V[task.handles.index]
        assert np.allclose(task.handles.target, (at - center) @ R.T + center, rtol=0, atol=1e-12)


def test_a_rotation_alone_beside_vertices_still_prescribes_the_rotation_of_the_surface(here, body):
    R = rotation(4)
    for kind in ({}, {"kind": "static"}):
        handles = read_handles(put([{"vertices": [5], "rotation": R.tolist(), **kind}]), body)
        assert np.array_equal(handles.rotation, R[None]) and np.array_equal(handles.target, body.V[[5]])


def test_a_rotation_about_the_origin_outside_of_a_group_is_noted(here, body):
    top = np.argsort(body.V[:, 2])[-4:].tolist()
    turn = {"vertices": top, "rotation": rotation(1).tolist(), "kind": "dynamic"}
    everywhere = {**turn, "vertices": list(range(body.n))}
    shift = {"vertices": top, "translation": [0, 0, 1]}
    for entries, words in (
        ([{"vertices": [0]}, turn], ["rotation or scale of entry 1 is about the origin"]),
        ([everywhere], []),
        ([shift], []),
        ([{**turn, "center": "centroid"}], []),
        ([{**turn, "kind": "static"}], []),
    ):
        file = read_handle_file(put(entries))
        notes = handle_notes(file, on_mesh(file, body), body)
        assert len(notes) == len(words) and all(a in b for a, b in zip(words, notes, strict=True)), notes


BOX = {"boxes": [[[-9, -9, -9], [9, 9, 9]]]}
TURN = np.eye(3).tolist()
#: An entry of a handle file, and words of its refusal.
ENTRIES = [
    ({"boxes": [[[9, 9, 9], [10, 10, 10]]]}, "entry 0: no vertex lies in its boxes"),
    ({"boxes": [[[0, 0, 0]]]}, '"boxes" must be a list of pairs of points'),
    ({"boxes": [[[0, 0, 0], [1, 1, np.nan]]]}, '"boxes" has a NaN or infinite position'),
    (
        {"boxes": [[[0, 3, 0], [1, 2, 1]]]},
        'box 0 of "boxes" .* swapped on axis y: 3 comes before 2',
    ),
    ({**BOX, "vertices": [1]}, 'either as "vertices", as "source" or as "boxes"'),
    ({**BOX, "target": [[0, 0, 0]]}, '"boxes" have no "target"'),
    ({**BOX, "kind": "dynamic"}, 'it is dynamic and has no "rotation" or'),
    ({**BOX, "rotation": [[1, 0], [0, 1]]}, '"rotation" must be three rows of three numbers'),
    ({**BOX, "rotation": (2 * np.eye(3)).tolist()}, "its rows must have length 1 and be perpendicular"),
    ({**BOX, "rotation": (-np.eye(3)).tolist()}, "it mirrors"),
    ({**BOX, "rotation": [0, 0, 0, 2]}, "a quaternion has length 1, not 2"),
    ({**BOX, "translation": [[0, 0, 0]]}, '"translation" must be three numbers'),
    ({**BOX, "rotation": TURN, "center": [0, 0]}, '"center" must be three numbers or "centroid"'),
    ({**BOX, "rotation": TURN, "center": "middle"}, '"center" must be .* or "centroid", not "middle"'),
    ({"vertices": [1], "center": [0, 0, 0]}, '"center" needs a "rotation" or a "scale"'),
    ({"name": "a", "landmark": "a", "vertices": [1]}, 'entry 0 "a": .* either as "name" or as "landmark"'),
    ({"name": [], "vertices": [1]}, 'entry 0: "name" must be a name'),
    ({"landmark": True, "vertices": [1]}, 'entry 0: "landmark" must be a name'),
    ({"kind": "moved", "vertices": [1]}, 'it is moved and has no "target" or "rotation"'),
    ({"kind": "free", "vertices": [1]}, "unknown kind 'free'; use fixed, moved or unused"),
    ({"kind": ["fixed"], "vertices": [1]}, "unknown kind .*; use fixed, moved or unused"),
    (1, "entry 0: it is no JSON object"),
    ({"kind": "static"}, '"vertices"'),
    ({"vertices": [10**9]}, r"0\.\.\d+, not 1000000000"),
    ({"vertices": [1], "weight": 0}, '"weight"'),
    ({"vertices": [1], "target": [[0, 0, 0]], "translation": [1, 0, 0]}, 'as "target" or as "translation"'),
    ({"vertices": [1], "target": [[0, 0, 0]], "scale": 2}, 'as "target" or as "scale"'),
    ({"vertices": [1, 2], "target": [[0, 0, 0]]}, "2 handles have 1 target; each needs one"),
    *(
        ({"vertices": [1], "scale": scale}, 'entry 0: "scale" must be a number above 0')
        for scale in (0, -1, "2", True, None, [1, 2, 3], np.inf)
    ),
    ({"vertices": [1], "55": 5}, 'entry 0: there is no key "55"; the keys are name, .*'),
    ({"kind": "unused", "vertces": [1]}, "no key \"vertces\"; did you mean 'vertices'"),
    ({"vertices": [1], "k\n\ud800" + 999 * "k": 1}, r'no key "k\\n\\ud800k+";'),
]
#: A whole file, and words of its refusal.
DOCUMENTS = [
    ({"handles": [{"vertices": [1]}], "handels": 3}, "pose.json: .* \"handels\"; did you mean 'handles'"),
    ({"handels": []}, 'pose.json: expected an object with a list "handles"'),
    ({"handles": [{"kind": "unused"}]}, "pose.json: there are no handles"),
]


@pytest.mark.parametrize(
    ("document", "words"), [*(({"handles": [entry]}, words) for entry, words in ENTRIES), *DOCUMENTS]
)
def test_a_mistake_is_refused_in_the_words_of_the_file(here, body, document, words):
    with pytest.raises(InputError, match=words):
        read_handles(put(document), body)


def test_both_vocabularies_are_read(here, body):
    """A file in the words name, fixed and moved equals the file in the words landmark, static and dynamic."""
    words = {"landmark": "name", "static": "fixed", "dynamic": "moved"}
    entries = [
        {"landmark": "foot", "kind": "static", "vertices": [1, 2], "translation": [0, 0, 1]},
        {"landmark": "hand", "kind": "dynamic", "vertices": [7, 8], "target": [[0, 0, 1], [0, 1, 1]]},
    ]
    text = json.dumps(entries)
    for word, other in words.items():
        text = text.replace(json.dumps(word), json.dumps(other))
    old, new = read_handle_file(put(entries)), read_handle_file(put(json.loads(text)))
    assert [group.name for group in new.groups] == [group.name for group in old.groups] == ["foot", "hand"]
    a, b = on_mesh(old, body), on_mesh(new, body)
    assert np.array_equal(a.index, b.index) and np.array_equal(a.target, b.target)
    assert a.dynamic.tolist() == b.dynamic.tolist() == [False] * 2 + [True] * 2


HUGE = 10**400
ODD = [None, True, "1", "", [], {}, [[]], [[[]]], [None], [True], ["1"], [[1, "2", 3]], [[1, 2]], -1, HUGE]
ODD += [float("nan"), [float("inf")], [HUGE], [[HUGE, 0, 0]], [[0, 0, HUGE]] * 3, {"runs": []}]
VALID = {
    "vertices": {"landmark": "a", "vertices": [1], "target": [[0, 0, 0]], "weight": 2},
    "source": {"source": bumpy(3).V[:1].tolist(), "target": [[0, 0, 0]], "rotation": np.eye(3).tolist()},
    "boxes": {
        "boxes": [[[-9, -9, -9], [9, 9, 9]]],
        "kind": "dynamic",
        "rotation": rotation(1).tolist(),
        "translation": [0, 0, 0],
        "center": "centroid",
    },
}


@pytest.mark.parametrize("way", VALID)
def test_odd_values_are_refused_in_one_sentence(here, body, way):
    entry = VALID[way]
    assert len(read_handles(put([entry]), body)) > 0
    for key in entry:
        for value in ODD:
            if key == "landmark" and type(value) in (str, int):
                continue
            with pytest.raises(InputError, match='entry 0( "a")?: ') as found:
                read_handles(put([{**entry, key: value}]), body)
            message = str(found.value)
            assert "\n" not in message and len(message) < 300, (key, value)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be", "utf-32"])
def test_files_of_other_systems_are_read(tmp_path, body, encoding):
    mark = "\ufeff" if encoding.endswith("e") else ""  # Python itself writes the marks of others
    path = tmp_path / "a.json"
    path.write_bytes((mark + '{"handles": [{"landmark": "Fu\u00df", "vertices": [7]}]}').encode(encoding))
    assert read_handle_file(path).groups[0].name == "Fu\u00df"


def test_text_in_no_encoding_is_refused(tmp_path, body):
    (tmp_path / "a.json").write_bytes(b'{"handles": "\xff\xff"}')
    with pytest.raises(InputError, match="not readable as JSON .it is neither UTF-8 nor UTF-16 text"):
        read_handles(tmp_path / "a.json", body)


@pytest.mark.parametrize("groups", [1, 2])
@pytest.mark.parametrize("by", ["vertices", "source"])
def test_targets_of_one_vertex_may_differ_by_a_millionth_of_the_diagonal(here, body, by, groups):
    at = body.V[5]
    place = [5, 5] if by == "vertices" else [at.tolist()] * 2

    def read(gap: float) -> Handles:
        target = [at.tolist(), (at + [gap * body.diagonal, 0, 0]).tolist()]
        entries = [{by: place[i::groups], "target": target[i::groups]} for i in range(groups)]
        return read_handles(put(entries), body)

    assert len(read(9e-7)) == 1
    with pytest.raises(InputError, match="contradictory targets"):
        read(2.2e-6)
    with pytest.raises(InputError, match="vertex 5 has contradictory targets"):
        deform(body.V, body.F, [5, 5], [at, at + 2e-6 * body.diagonal])


def test_targets_of_copies_may_differ_as_far_from_the_origin_as_single_precision_does(here):
    V, F, seam = torn(shifted(bumpy(2), [100, -3, 1]))
    V = V.astype(np.float32)
    V[-len(seam) :] = np.nextafter(V[-len(seam) :], np.float32(200))
    write_mesh("far.glb", V, F)  # in single precision
    at = np.concatenate([seam[:3], np.arange(len(V) - len(seam), len(V))[:3]])
    target = V[at] + np.array([0, 0, 0.125])
    assert len(np.unique(deform(V, F, at, target)[at], axis=0)) == 3

    def read() -> Handles:
        path = put([{"vertices": at.tolist(), "target": target.tolist()}])
        return read_task("far.glb", handles=str(path)).handles

    assert len(read()) == 3
    target[5] += 1e-4
    with pytest.raises(InputError, match="contradictory targets"):
        read()


def test_positions_that_share_a_vertex_are_merged_as_far_as_their_distances_explain(here, body):
    at, aside = body.V[5], np.array([1e-3, 0, 0])
    source = [at - aside, at + aside, *body.V[100:104]]
    for way, words in ((0.0, 0), (2.5e-3, 1)):
        target = np.array(source) + [0, 0, 1]
        target[1, 1] += 2 * way
        file = read_handle_file(put([{"source": np.array(source).tolist(), "target": target.tolist()}]))
        handles = on_mesh(file, body)
        notes = handle_notes(file, handles, body)
        assert handles.merged == 1 and len(notes) == words
        assert handles.merge_distance == pytest.approx(way, rel=0.1, abs=1e-12)
        assert not words or notes[0].startswith("1 position was merged with another")
    target[1, 1] += 5e-3
    with pytest.raises(InputError, match="2 positions of group 0 have the same nearest vertex, 5"):
        read_handles(put([{"source": np.array(source).tolist(), "target": target.tolist()}]), body)


def test_unused_groups_are_skipped_and_group_numbers_count_entries(here, body):
    entries = [
        {"kind": "unused", "vertices": [10**9], "source": "nonsense"},
        {"kind": "static", "vertices": [4]},
    ]
    handles = read_handles(put(entries), body)
    assert handles.index.tolist() == [4] and handles.group.tolist() == [1]


def test_ids_count_the_vertices_of_the_file_where_the_mesh_is_a_repaired_copy(here):
    mesh = tetrahedron()
    soup = np.concatenate([[[9.0, 9, 9]], mesh.V[mesh.F].reshape(-1, 3)])
    repaired, vertex, _ = surface(soup, 1 + np.arange(12).reshape(-1, 3), repair=True)
    entries = [{"vertices": [12]}, {"vertices": [1], "target": [[5, 5, 5]]}]
    handles = read_handles(put(entries), repaired, vertex=vertex)
    assert np.array_equal(repaired.V[handles.index], soup[[12, 1]])
    assert handles.target.tolist() == [soup[12].tolist(), [5, 5, 5]]
    with pytest.raises(InputError, match="entry 0: vertex 0 belongs to no face"):
        read_handles(put([{"vertices": [1, 0]}]), repaired, vertex=vertex)
    with pytest.raises(InputError, match=r"vertex ids must lie in 0\.\.12, not 13"):
        read_handles(put([{"vertices": [13]}]), repaired, vertex=vertex)


def test_written_handles_read_back_the_same(tmp_path, body):
    rng = np.random.default_rng(3)
    index, dynamic = rng.permutation(body.n)[:9], rng.random(9) < 0.5
    target = np.where(dynamic[:, None], rng.normal(size=(9, 3)), body.V[index])
    group = np.array([5, 2**60, 2**60 + 1])[rng.integers(0, 3, 9)]
    weight = np.where(dynamic & (group == 5), 0.5, np.inf)
    handles = Handles(index, target, dynamic=dynamic, group=group, weight=weight)
    write_handles(tmp_path / "a.json", handles)
    back = read_handles(tmp_path / "a.json", body)
    a, b = np.argsort(handles.index), np.argsort(back.index)
    for name in ("index", "target", "dynamic", "weight"):
        assert np.array_equal(getattr(handles, name)[a], getattr(back, name)[b])
    # Groups are renumbered. A group with static and dynamic handles becomes two groups.
    pairs = set(zip(handles.group[a] * 2 + handles.dynamic[a], back.group[b], strict=True))
    assert len(pairs) == len({p[0] for p in pairs}) == len({p[1] for p in pairs})
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_a_task_is_made_of_what_of_a_file_is_a_surface(here):
    """The file has an unused first vertex, a face that repeats a vertex, and a body without handles."""
    body = bumpy(1)
    V = np.concatenate([[[9.0, 9, 9]], body.V, body.V + 5])
    F = np.concatenate([body.F + 1, [[1, 1, 2]], body.F + 1 + body.n])
    write_mesh("bodies.ply", V, F)
    write_handles("pose.json", Handles([1, 5], V[[1, 5]]))
    with pytest.raises(InputError, match="1 of the mesh's 2 components has no handle"):
        read_task("bodies.ply", handles="pose.json", refuse_unconstrained=True)
    task = read_task("bodies.ply", handles="pose.json")
    assert np.array_equal(task.mesh.V, V[1:]) and task.handles.index.tolist() == [0, 4]
    result = deform(task, vertices=30)
    assert result.facts.unconstrained == 1 and np.abs(result.vertices - V[1:]).max() < 1e-6


def test_an_amount_moves_handles_a_part_of_the_way(here, body):
    R, t, at = rotation(1), np.array([0.3, 0, -0.2]), body.V[[5, 6, 7]]
    angle = np.arccos((np.trace(R) - 1) / 2)
    entries = [
        {
            "vertices": [5, 6, 7],
            "rotation": R.tolist(),
            "translation": t.tolist(),
            "center": "centroid",
            "scale": 1.4,
        },
        {"vertices": [100, 101], "target": (body.V[[100, 101]] + t).tolist(), "rotation": R.tolist()},
        {"vertices": [200], "kind": "fixed"},
        {"source": (body.V[[300, 301]] + 1e-3).tolist(), "target": (body.V[[300, 301]] + 1).tolist()},
    ]
    path = put(entries)
    whole = read_handles(path, body)
    for amount in (0.0, 0.5, 1.0, 2.0):
        part = read_handles(path, body, amount=amount)
        rest, straight = body.V[whole.index], whole.group > 0
        assert np.array_equal(part.index, whole.index) and np.array_equal(part.dynamic, whole.dynamic)
        expected = rest + amount * (whole.target - rest)
        np.testing.assert_allclose(part.target[straight], expected[straight], rtol=0, atol=1e-15)
        centered = part.target[~straight] - part.target[~straight].mean(axis=0)
        turn, _ = rigid_motion(at - at.mean(axis=0), centered)
        scale = np.linalg.norm(centered) / np.linalg.norm(at - at.mean(axis=0))
        assert scale == pytest.approx(1 + amount * 0.4) and part.target[~straight].mean(
            axis=0
        ) == pytest.approx(at.mean(axis=0) + amount * t)
        # Twice the angle may be more than half a turn.
        assert np.trace(turn) == pytest.approx(1 + 2 * np.cos(amount * angle))
        if amount == 0:
            assert np.array_equal(part.target, rest) and part.rotation is None
        else:
            own = part.rotation[part.has_rotation][0]
            assert np.trace(own) == pytest.approx(1 + 2 * np.cos(amount * angle))
            assert own @ R == pytest.approx(R @ own)


@pytest.mark.parametrize("amount", [-0.1, 2.1, np.nan, np.inf])
def test_an_amount_out_of_range_is_refused(here, body, amount):
    with pytest.raises(InputError, match="the amount goes from 0 to 2, not"):
        read_handles(put([{"vertices": [0]}]), body, amount=amount)


def test_a_scale_cannot_shrink_below_nothing(here, body):
    with pytest.raises(InputError, match="entry 0: the scale 0.4 cannot be exceeded 2 times"):
        read_handles(put([{"vertices": [5], "scale": 0.4}]), body, amount=2)

import json
from pathlib import Path

import numpy as np
import pytest

from sshade import Handles, InputError, Mesh, deform
from sshade.cli.handle_notes import handle_notes
from sshade.files.door import on_mesh
from sshade.files.handle_files import read_handle_file
from sshade.files.meshes import write_mesh
from sshade.files.task_files import read_handles, read_task, write_handles
from sshade.mesh.rigid import Similarity, rigid_motion
from sshade.mesh.surface import surface
from tests.shapes import bumpy, rotation, shifted, tetrahedron, torn


@pytest.fixture
def write(tmp_path):
    """Write handle entries, or any text, to a JSON file."""

    def _write(content, name: str = "pose.json") -> Path:
        text = content if isinstance(content, str) else json.dumps({"handles": content})
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return _write


def test_handles_by_position_are_snapped_as_positions_are(write, body):
    rng = np.random.default_rng(0)
    foot = body.V[[10, 11]] + 1e-3
    hand = body.V[[200, 201, 202]] + rng.normal(scale=1e-3, size=(3, 3))
    moved = hand @ rotation(1).T + [1, 0, 0]
    entries = [
        {"kind": "static", "source": foot.tolist(), "target": (foot + 1).tolist()},
        {"kind": "dynamic", "source": hand.tolist(), "target": moved.tolist(), "weight": 3},
    ]
    handles = read_handles(write(entries), body)
    assert handles.weight.tolist() == [np.inf, np.inf, 3, 3, 3]
    parts = [
        Handles.from_positions(body, foot, foot, dynamic=False),
        Handles.from_positions(body, hand, moved),
    ]
    assert np.array_equal(handles.index, np.concatenate([part.index for part in parts]))
    assert np.array_equal(handles.target, np.concatenate([part.target for part in parts]))
    assert np.array_equal(handles.snap_distance, np.concatenate([part.snap_distance for part in parts]))
    assert handles.group.tolist() == [0, 0, 1, 1, 1]

    raw = read_handles(write(entries), body, raw=True)
    assert np.allclose(raw.target, np.concatenate([foot + 1, moved]), rtol=0, atol=1e-15)


def test_static_handles_ignore_a_target_unless_raw(write, body):
    entries = [{"kind": "static", "vertices": [5], "target": [[9, 9, 9]]}]
    assert np.array_equal(read_handles(write(entries), body).target, body.V[[5]])
    assert read_handles(write(entries), body, raw=True).target.tolist() == [[9, 9, 9]]


def test_a_region_is_all_vertices_in_its_boxes(write, body):
    V = body.V
    low, high = V.min(axis=0), V.max(axis=0)
    bottom = [low.tolist(), [*high[:2], low[2] + 0.5]]
    side = [[high[0] - 0.2, *low[1:]], high.tolist()]
    R, t = rotation(2), [1.0, 2.0, 3.0]
    entry = {"kind": "static", "boxes": [bottom, side], "rotation": R.tolist(), "translation": t}
    inside = (V[:, 2] <= low[2] + 0.5) | (V[:, 0] >= high[0] - 0.2)
    for raw in (False, True):
        handles = read_handles(write([entry]), body, raw=raw)
        assert np.array_equal(handles.index, np.flatnonzero(inside)) and not handles.dynamic.any()
        target = V[inside] @ R.T + t if raw else V[inside]
        assert np.allclose(handles.target, target, rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"boxes": [[[9, 9, 9], [10, 10, 10]]]}, "entry 0: no vertex lies in its boxes"),
        ({"boxes": [[[0, 0, 0]]]}, '"boxes" must be a list of pairs of points'),
        ({"boxes": [[[0, 0, 0], [1, 1, float("nan")]]]}, '"boxes" has a NaN or infinite position'),
        ({"rotation": [[1, 0], [0, 1]]}, '"rotation" must be three rows of three numbers'),
        ({"rotation": (2 * np.eye(3)).tolist()}, "its rows must have length 1 and be perpendicular"),
        ({"rotation": (-np.eye(3)).tolist()}, "it mirrors"),
        ({"rotation": [0, 0, 0, 2]}, "a quaternion has length 1, not 2"),
        ({"translation": [[0, 0, 0]]}, '"translation" must be three numbers'),
        ({"vertices": [1]}, 'either as "vertices", as "source" or as "boxes"'),
        ({"target": [[0, 0, 0]]}, '"boxes" have no "target"'),
        ({"center": [0, 0]}, '"center" must be three numbers or "centroid"'),
        ({"center": "middle"}, '"center" must be three numbers or "centroid", not "middle"'),
        ({"rotation": ..., "translation": ..., "kind": "dynamic"}, 'it is dynamic and has no "rotation" or'),
        (
            {"boxes": [[[-9, -9, -9], [9, 9, 9]], [[0, 3, 0], [1, 2, 1]]]},
            'entry 0: box 1 of "boxes" has its corners swapped on axis y: 3 comes before 2',
        ),
    ],
)
def test_a_wrong_region_is_refused(write, body, change, message):
    entry = {"boxes": [[[-9, -9, -9], [9, 9, 9]]], "rotation": np.eye(3).tolist(), "translation": [0, 0, 0]}
    assert len(read_handles(write([entry]), body)) == body.n
    changed = {key: value for key, value in (entry | change).items() if value is not ...}
    with pytest.raises(InputError, match=message):
        read_handles(write([changed]), body)


def test_groups_of_every_kind_move_rigidly_and_a_missing_part_is_the_identity(write, body):
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
        ):
            handles = read_handles(write([{**place, **motion}]), body)
            assert handles.index.tolist() == ids and handles.dynamic.all() and handles.rotation is None
            assert np.allclose(handles.target, target, rtol=0, atol=1e-14), motion
            still = read_handles(write([{**place, **motion, "kind": "static"}]), body)
            assert np.array_equal(still.target, at) and not still.dynamic.any()
        moved = read_handles(write([{**place, "translation": t}]), body)
        assert np.array_equal(moved.target, at + t)  # exact


@pytest.mark.parametrize("weld", [None, 0])
def test_the_centroid_does_not_depend_on_seams(write, body, tmp_path, weld):
    """Copies along a seam count once: as one vertex of the surface, or as places that are equal."""
    V, F, seam = torn(body)
    write_mesh(tmp_path / "torn.ply", V, F)
    own = np.intersect1d(np.flatnonzero(V[:, 0] > 0), F)
    places = np.unique(V[own], axis=0)
    assert len(np.intersect1d(own, seam)) and len(places) < len(own)
    center, R = places.mean(axis=0), rotation(4)
    entry = {"rotation": R.tolist(), "kind": "moved", "center": "centroid"}
    for place in ({"vertices": own.tolist()}, {"source": V[own].tolist()}):
        task = read_task(str(tmp_path / "torn.ply"), handles=str(write([{**entry, **place}])), weld=weld)
        at = task.mesh.V[task.handles.index]
        assert np.allclose(task.handles.target, (at - center) @ R.T + center, rtol=0, atol=1e-12)
    twice = Similarity(R, np.zeros(3), "centroid")(np.repeat(places[:9], [5, *[1] * 8], axis=0))
    assert np.allclose(twice[4:], Similarity(R, np.zeros(3), "centroid")(places[:9]), rtol=0, atol=1e-12)


def test_a_rotation_alone_beside_vertices_still_prescribes_the_rotation_of_the_surface(write, body):
    R = rotation(4)
    for kind in ({}, {"kind": "static"}):
        handles = read_handles(write([{"vertices": [5], "rotation": R.tolist(), **kind}]), body)
        assert np.array_equal(handles.rotation, R[None]) and np.array_equal(handles.target, body.V[[5]])


def test_a_rotation_about_the_origin_outside_of_a_group_is_noted(write, body):
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
        file = read_handle_file(write(entries))
        notes = handle_notes(file, on_mesh(file, body), body)
        assert len(notes) == len(words) and all(a in b for a, b in zip(words, notes, strict=True)), notes


@pytest.mark.parametrize(
    "more", [{"slide": {"plane": [0, 0, 1]}}, {"free": "position", "rotation": [0, 0, 0, 1]}]
)
def test_handles_without_a_position_are_refused_with_what_to_use(write, body, more):
    with pytest.raises(
        InputError, match="entry 0: .* are no longer supported; use a soft handle, with a targ"
    ):
        read_handles(write([{"vertices": [1], **more}]), body)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"handles": [{"vertices": [1]}, {"comment": 5}]}, 'pose.json: entry 1: .*"comment"; did you mean "'),
        ({"handles": [{"kind": "unused", "vertces": [1]}]}, 'no key "vertces"; did you mean "vertices"'),
        ({"handles": [{"vertices": [1]}], "handels": 3}, 'pose.json: .* "handels"; did you mean "handles"'),
        ({"handles": [{"vertices": [1], "k\n\ud800" + 999 * "k": 1}]}, r'no key "k\\n\\ud800k+";'),
        ({"handles": [{"vertices": [1]}], "volumes": []}, "no longer supported; use the option volume_goal"),
        (
            {"handles": [{"vertices": [1]}], "frames": [{}]},
            r'animations \("frames"\) are no longer supported',
        ),
        ({"handles": [{"vertices": {"run": [[1, 2]]}}]}, '"vertices" is no list'),
        ({"handles": [{"vertices": {"runs": [[1, 0]]}}]}, '"runs" of "vertices" must be a list of pairs'),
        ({"handles": [{"vertices": {"runs": [[0, 10**12]]}}]}, "stand for more than 100,000,000 ids"),
    ],
)
def test_unknown_keys_are_refused_with_the_nearest_key(write, body, content, message):
    with pytest.raises(InputError, match=message):
        read_handles(write(json.dumps(content)), body)


def test_both_vocabularies_are_read(write, body):
    """A file in the words name, fixed and moved equals the file in the words landmark, static and dynamic."""
    words = {"landmark": "name", "static": "fixed", "dynamic": "moved"}
    move = {"vertices": [7, 8], "target": [[0, 0, 1], [0, 1, 1]]}
    entries = [
        {"landmark": "foot", "kind": "static", "vertices": [1, 2], "translation": [0, 0, 1]},
        {"landmark": "hand", "kind": "dynamic", **move},
        {"landmark": "tail", "kind": "dynamic", "source": body.V[[30]].tolist(), "translation": [1, 0, 0]},
    ]
    text = json.dumps({"handles": entries})
    old = read_handle_file(write(text))
    for word, other in words.items():
        text = text.replace(json.dumps(word), json.dumps(other))
    new = read_handle_file(write(text))
    assert [group.name for group in new.groups] == ["foot", "hand", "tail"]
    assert [group.moves for group in new.groups] == [False, True, True]
    assert [(group.name, group.moves) for group in old.groups] == [(g.name, g.moves) for g in new.groups]
    a, b = on_mesh(old, body), on_mesh(new, body)
    assert np.array_equal(a.index, b.index) and np.array_equal(a.target, b.target)
    assert np.array_equal(a.dynamic, b.dynamic) and b.dynamic.tolist() == [False] * 2 + [True] * 3


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (
            {"name": "a", "landmark": "a", "vertices": [1]},
            'entry 0 "a": .* either as "name" or as "landmark"',
        ),
        ({"name": [], "vertices": [1]}, 'entry 0: "name" must be a name'),
        ({"landmark": True, "vertices": [1]}, 'entry 0: "landmark" must be a name'),
        ({"kind": "moved", "vertices": [1]}, 'it is moved and has no "target" or "rotation"'),
        ({"kind": "dynamic", "vertices": [1]}, 'it is dynamic and has no "target" or "rotation"'),
        ({"kind": "free", "vertices": [1]}, "unknown kind 'free'; use fixed, moved or unused"),
        ({"kind": ["fixed"], "vertices": [1]}, "unknown kind .*; use fixed, moved or unused"),
        (1, "entry 0"),
        ({"kind": "static"}, '"vertices"'),
        ({"vertices": [10**9]}, r"0\.\.\d+, not 1000000000"),
        ({"vertices": [1], "weight": 0}, '"weight"'),
        ({"vertices": [1], "target": [[0, 0, 0]], "translation": [1, 0, 0]}, '"translation"'),
    ],
)
def test_mistakes_in_entries_are_refused_in_the_words_of_the_file(write, body, entry, message):
    with pytest.raises(InputError, match=message):
        read_handles(write([entry]), body)


HUGE = 10**400
ODD = [None, True, "1", "", [], {}, [[]], [[[]]], [None], [True], ["1"], [[1, "2", 3]], [[1, 2]], -1, HUGE]
ODD += [float("nan"), [float("inf")], [HUGE], [[HUGE, 0, 0]], [[0, 0, HUGE]] * 3, {"runs": []}, {"runs": [1]}]
ODD += [{"base64": "A", "dtype": "<i4", "shape": [1]}, {"base64": "AAA=", "dtype": "<f8", "shape": [-1, 3]}]
ODD += [{"base64": 3, "dtype": "O", "shape": 1}, {"base64": "AAAA", "dtype": "<i4", "shape": [10**30]}]
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
def test_odd_values_are_refused_in_one_sentence(write, body, way):
    entry = VALID[way]
    assert len(read_handles(write([entry]), body)) > 0
    for key in entry:
        for value in ODD:
            if key == "landmark" and type(value) in (str, int):
                continue
            with pytest.raises(InputError, match='entry 0( "a")?: ') as found:
                read_handles(write([{**entry, key: value}]), body)
            message = str(found.value)
            assert "\n" not in message and len(message) < 300, (key, value)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_files_of_other_systems_are_read(tmp_path, body, far_body, encoding):
    mark = "\ufeff" if encoding.endswith("e") else ""  # Python itself writes the marks of others
    path = tmp_path / "a.json"
    path.write_bytes((mark + '{"handles": [{"landmark": "Fu\u00df", "vertices": [7]}]}').encode(encoding))
    assert read_handle_file(path).groups[0].name == "Fu\u00df"
    assert read_handles(path, body).index.tolist() == [7]
    experiment = Experiment(tmp_path / "x", far_body, AXES[0])
    expected = read_handles(experiment.path, far_body)
    for part in experiment.folder.rglob("*.*"):
        part.write_bytes((mark + part.read_text()).encode(encoding))
    again = read_handles(experiment.path, far_body)
    assert np.array_equal(again.index, expected.index) and np.array_equal(again.target, expected.target)


def test_text_in_no_encoding_is_refused(tmp_path, body):
    (tmp_path / "a.json").write_bytes(b'{"handles": "\xff\xff"}')
    with pytest.raises(InputError, match="not readable as JSON .it is neither UTF-8 nor UTF-16 text"):
        read_handles(tmp_path / "a.json", body)


@pytest.mark.parametrize("groups", [1, 2])
@pytest.mark.parametrize("by", ["vertices", "source"])
def test_targets_of_one_vertex_may_differ_by_a_millionth_of_the_diagonal(write, body, by, groups):
    at = body.V[5]
    place = [5, 5] if by == "vertices" else [at.tolist()] * 2

    def read(gap: float) -> Handles:
        target = [at.tolist(), (at + [gap * body.diagonal, 0, 0]).tolist()]
        entries = [{by: place[i::groups], "target": target[i::groups]} for i in range(groups)]
        return read_handles(write(entries), body)

    assert len(read(9e-7)) == 1
    with pytest.raises(InputError, match="contradictory targets"):
        read(2.2e-6)
    with pytest.raises(InputError, match="vertex 5 has contradictory targets"):
        deform(body.V, body.F, [5, 5], [at, at + 2e-6 * body.diagonal])


def test_targets_of_copies_may_differ_as_far_from_the_origin_as_single_precision_does(write, tmp_path):
    V, F, seam = torn(shifted(bumpy(2), [100, -3, 1]))
    V = V.astype(np.float32)
    V[-len(seam) :] = np.nextafter(V[-len(seam) :], np.float32(200))
    write_mesh(tmp_path / "far.glb", V, F)  # in single precision
    at = np.concatenate([seam[:3], np.arange(len(V) - len(seam), len(V))[:3]])
    target = V[at] + np.array([0, 0, 0.125])
    assert len(np.unique(deform(V, F, at, target)[at], axis=0)) == 3

    def read() -> Handles:
        path = write([{"vertices": at.tolist(), "target": target.tolist()}])
        return read_task(str(tmp_path / "far.glb"), handles=str(path)).handles

    assert len(read()) == 3
    target[5] += 1e-4
    with pytest.raises(InputError, match="contradictory targets"):
        read()


def test_positions_that_share_a_vertex_are_merged_as_far_as_their_distances_explain(write, body):
    at, aside = body.V[5], np.array([1e-3, 0, 0])
    source = [at - aside, at + aside, *body.V[100:104]]
    for way, words in ((0.0, 0), (2.5e-3, 1)):
        target = np.array(source) + [0, 0, 1]
        target[1, 1] += 2 * way
        file = read_handle_file(write([{"source": np.array(source).tolist(), "target": target.tolist()}]))
        handles = on_mesh(file, body)
        notes = handle_notes(file, handles, body)
        assert handles.merged == 1 and len(notes) == words
        assert handles.merge_distance == pytest.approx(way, rel=0.1, abs=1e-12)
        assert not words or notes[0].startswith("1 position was merged with another")
    target[1, 1] += 5e-3
    with pytest.raises(InputError, match="2 positions of group 0 have the same nearest vertex, 5"):
        read_handles(write([{"source": np.array(source).tolist(), "target": target.tolist()}]), body)


def test_unused_groups_are_skipped_and_group_numbers_count_entries(write, body):
    entries = [
        {"kind": "unused", "vertices": [10**9], "source": "nonsense"},
        {"kind": "static", "vertices": [4]},
    ]
    handles = read_handles(write(entries), body)
    assert handles.index.tolist() == [4] and handles.group.tolist() == [1]


def test_ids_count_the_vertices_of_the_file_where_the_mesh_is_a_repaired_copy(write):
    mesh = tetrahedron()
    soup = np.concatenate([[[9.0, 9, 9]], mesh.V[mesh.F].reshape(-1, 3)])
    repaired, vertex, _ = surface(soup, 1 + np.arange(12).reshape(-1, 3), repair=True)
    entries = [{"vertices": [12]}, {"vertices": [1], "target": [[5, 5, 5]]}]
    handles = read_handles(write(entries), repaired, vertex=vertex)
    assert np.array_equal(repaired.V[handles.index], soup[[12, 1]])
    assert handles.target.tolist() == [soup[12].tolist(), [5, 5, 5]]
    with pytest.raises(InputError, match="entry 0: vertex 0 belongs to no face"):
        read_handles(write([{"vertices": [1, 0]}]), repaired, vertex=vertex)
    with pytest.raises(InputError, match=r"vertex ids must lie in 0\.\.12, not 13"):
        read_handles(write([{"vertices": [13]}]), repaired, vertex=vertex)


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


def test_large_groups_are_written_compactly_and_small_groups_as_lists(tmp_path, body):
    """The compact form has the same bits in fewer lines and bytes. Lists of numbers are still read."""
    rng = np.random.default_rng(4)
    groups = [rng.permutation(300)[:200], np.r_[300:400, 420:500], np.arange(600, 608)]
    index, group = np.concatenate(groups), np.repeat([0, 1, 2], [200, 180, 8])
    target = body.V[index] @ rotation(3).T + rng.normal(size=3)
    target[group == 1] = body.V[index[group == 1]]
    handles = Handles(index, target, dynamic=group != 1, group=group)
    write_handles(tmp_path / "new.json", handles, static_at_rest=True)
    entries = json.loads((tmp_path / "new.json").read_text())["handles"]
    assert set(entries[0]["vertices"]) == {"base64", "dtype", "shape"} == set(entries[0]["target"])
    assert entries[1]["vertices"] == {"runs": [[300, 100], [420, 80]]} and "target" not in entries[1]
    assert entries[2]["vertices"] == list(range(600, 608))
    old = [
        {"kind": kind, "vertices": index[group == g].tolist(), "target": target[group == g].tolist()}
        for g, kind in enumerate(["dynamic", "static", "dynamic"])
    ]
    (tmp_path / "old.json").write_text(json.dumps({"handles": old}, indent=1))
    sizes = [(tmp_path / name).stat().st_size for name in ("new.json", "old.json")]
    assert sizes[0] < 0.3 * sizes[1] and len((tmp_path / "new.json").read_text().splitlines()) < 30
    for name in ("new.json", "old.json"):
        back = read_handles(tmp_path / name, body)
        for field in ("index", "target", "dynamic", "group"):
            assert np.array_equal(getattr(back, field), getattr(handles, field)), (name, field)


AXES = [
    np.eye(3),
    np.diag([-1.0, 1, -1]),
    np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]),
]
POSE = """
handles:
  static:
    positions: [foot, heel]
  moving:
    positions: [hand]
    transform: [hand_up]
"""


@pytest.fixture(scope="module")
def far_body() -> Mesh:
    """Return a mesh with another unit of length, far from the origin."""
    mesh = bumpy(3)
    return Mesh(170 * mesh.V + [300, -50, 20], mesh.F)


class Experiment:
    """A folder of Implicit-ARAP. Its coordinates have other axes, are centred and are scaled to 0.8."""

    def __init__(self, folder: Path, mesh: Mesh, axes: np.ndarray, *, noise: float = 0.0) -> None:
        self.folder, self.axes = folder, axes
        self.centre = np.average(mesh.V[mesh.F].mean(axis=1), axis=0, weights=mesh.face_areas)
        self.scale = 0.8 / np.abs(mesh.V - self.centre).max()
        for name in ("parts", "transforms"):
            (folder / name).mkdir(parents=True)
        order, rng = np.argsort(mesh.V @ [0.2, 0.3, 1.0]), np.random.default_rng(0)
        self.ids = {"foot": order[:20], "heel": order[100:110], "hand": order[-25:]}
        for name, vertices in self.ids.items():
            points = self.to_file(mesh.V[vertices])
            noisy = points + rng.normal(scale=noise, size=points.shape)
            self.put("parts", name, noisy)
        self.put("transforms", "hand_up", noisy @ rotation(1).T + [0.1, 0.2, 0.3])
        self.moved = (points @ rotation(1).T + [0.1, 0.2, 0.3]) @ axes / self.scale + self.centre
        self.path = folder / "pose.yaml"
        self.path.write_text(POSE)

    def to_file(self, V: np.ndarray) -> np.ndarray:
        return ((V - self.centre) * self.scale) @ self.axes.T

    def put(self, kind: str, name: str, points: np.ndarray) -> None:
        np.savetxt(self.folder / kind / f"{name}.txt", points, fmt="%.17g")


@pytest.mark.parametrize("axes", AXES, ids=["same", "flipped", "cycled", "turned"])
@pytest.mark.parametrize("raw", [False, True])
def test_implicit_arap_targets_come_back_in_the_coordinates_of_the_mesh(tmp_path, far_body, axes, raw):
    experiment = Experiment(tmp_path / "x", far_body, axes)
    handles = read_handles(experiment.path, far_body, raw=raw)
    order = np.argsort(handles.index)
    expected = far_body.V.copy()
    expected[experiment.ids["hand"]] = experiment.moved
    assert np.array_equal(handles.index[order], np.sort(np.concatenate(list(experiment.ids.values()))))
    gap = np.linalg.norm(handles.target - expected[handles.index], axis=1)
    assert gap.max() <= 1e-6 * far_body.diagonal
    assert np.array_equal(np.sort(handles.index[handles.dynamic]), np.sort(experiment.ids["hand"]))
    assert np.unique(handles.group).tolist() == [0, 1, 2]


def test_points_a_little_off_the_surface_keep_the_parts_rigid_motion(tmp_path, far_body):
    """The points may come from another copy of the model. The targets are rigidly moved vertices."""
    experiment = Experiment(tmp_path / "x", far_body, AXES[2], noise=0.003)
    handles = read_handles(experiment.path, far_body)
    static = ~handles.dynamic
    assert np.array_equal(handles.target[static], far_body.V[handles.index[static]])
    at, to = far_body.V[handles.index[handles.dynamic]], handles.target[handles.dynamic]
    # A rigid motion keeps all distances between vertices.
    rest, apart = (np.linalg.norm(x[:, None] - x[None], axis=2) for x in (at, to))
    assert np.allclose(apart, rest, rtol=0, atol=1e-9 * far_body.diagonal)
    assert np.linalg.norm(to.mean(axis=0) - experiment.moved.mean(axis=0)) < 0.05 * far_body.diagonal


def test_a_little_rigid_motion_of_another_copy_is_found_by_icp(tmp_path, far_body):
    """Another triangulation has another centroid, so all points are off by the same shift."""
    experiment = Experiment(tmp_path / "x", far_body, AXES[3])
    everywhere = np.random.default_rng(0).permutation(far_body.n)[:200]
    shift, up = np.array([0.006, -0.004, 0.005]), np.array([0, 0, 0.5])
    points = experiment.to_file(far_body.V[everywhere]) + shift
    experiment.put("parts", "all", points)
    experiment.put("transforms", "moved", points + up)
    experiment.path.write_text("handles: {moving: {positions: [all], transform: [moved]}}")
    handles = read_handles(experiment.path, far_body, raw=True)
    # Raw targets are the mapped targets of the file. Without ICP, all would be off by the whole shift.
    target = far_body.V + up @ experiment.axes / experiment.scale
    gap = np.linalg.norm(handles.target - target[handles.index], axis=1)
    assert np.max(gap) < 0.75 * np.linalg.norm(shift) / experiment.scale


def _static(part: str) -> str:
    return f"handles: {{static: {{positions: [{part}]}}}}"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("handles: {statc: {positions: [foot]}}", '`handles`: .*"statc"; did you mean "static"'),
        ("handles: {static: {position: [foot]}}", '`handles.static`: .*"position"; did you mean "positions"'),
        ("handles: {moving: {positions: [hand], transforms: [a]}}", '"transforms"; did you mean "transform"'),
        (bytes(range(128, 256)).decode("latin-1"), "not readable as YAML"),
        ("- 1\n- 2\n", "`handles`"),
        (1_000 * "[", "not readable as YAML"),
        ("handles: !!python/object/apply:os.system ['touch hacked']\n", "not readable as YAML"),
        ("handles: {static: {}, moving: {}}", "there are no handles"),
        ("handles: {static: {positions: 3}}", "list of names"),
        (_static("head"), "head.txt"),
        (_static("../secret"), "'../secret' leads out of"),
        (_static("/etc/passwd"), "leads out of"),
        ("handles: {moving: {positions: [hand]}}", "1 moving parts have 0 transforms"),
        (_static("words"), "three numbers"),
        (_static("other"), "is this the mesh they were made for?"),
    ],
)
def test_a_wrong_file_of_implicit_arap_is_refused_in_one_sentence(here, far_body, content, message):
    experiment = Experiment(here / "x", far_body, AXES[0])
    path = experiment.path
    (path.parent / "parts" / "words.txt").write_text("a b c\n")
    experiment.put("parts", "other", [[0.1, 5, 5], [0.2, 5, 5], [0.1, 6, 5], [0.4, 7, 5]])
    (here / "secret.txt").write_text('"password"')
    path.write_text(content)
    with pytest.raises(InputError, match=message) as refused:
        read_handles(path, far_body)
    assert "\n" not in str(refused.value) and not list(here.rglob("hacked"))
    path.write_text("mesh: hand.ply\n" + POSE)
    assert len(read_handles(path, far_body))


def test_static_or_moving_parts_may_be_missing(tmp_path, far_body):
    path = Experiment(tmp_path / "x", far_body, AXES[0]).path
    path.write_text("handles: {static: {positions: [foot]}}")
    assert not read_handles(path, far_body).dynamic.any()
    path.write_text("handles: {moving: {positions: [hand], transform: [hand_up]}, static: }")
    assert read_handles(path, far_body).dynamic.all()


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


def test_an_amount_moves_handles_a_part_of_the_way(write, body):
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
    path = write(entries)
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
    assert np.array_equal(part.has_rotation, whole.has_rotation)
    for name in ("target", "rotation"):
        assert np.array_equal(
            getattr(read_handles(path, body, amount=1), name), getattr(whole, name), equal_nan=True
        )


@pytest.mark.parametrize("amount", [-0.1, 2.1, np.nan, np.inf])
def test_an_amount_out_of_range_is_refused(write, body, amount):
    with pytest.raises(InputError, match="the amount goes from 0 to 2, not"):
        read_handles(write([{"vertices": [0]}]), body, amount=amount)


def test_a_scale_acts_about_the_center_with_rotation_and_translation(write, body):
    R, at = rotation(1), body.V[[5, 6, 7]]
    center = at.mean(axis=0)
    for entry, expected in (
        ({"scale": 2}, 2 * at),
        ({"scale": 0.5, "center": "centroid"}, 0.5 * (at - center) + center),
        ({"scale": 3, "center": [1, 2, 3], "translation": [1, 0, 0]}, 3 * (at - [1, 2, 3]) + [2, 2, 3]),
        (
            {"scale": 1.5, "rotation": R.tolist(), "center": "centroid"},
            1.5 * (at - center) @ R.T + center,
        ),
    ):
        handles = read_handles(write([{"vertices": [5, 6, 7], **entry}]), body)
        np.testing.assert_allclose(handles.target, expected, rtol=0, atol=1e-14)
        assert handles.dynamic.all()
    with pytest.raises(InputError, match="entry 0: the scale 0.4 cannot be exceeded 2 times"):
        read_handles(write([{"vertices": [5], "scale": 0.4}]), body, amount=2)


@pytest.mark.parametrize("scale", [0, -1, "2", True, None, [1, 2, 3], 1e999])
def test_a_scale_is_a_number_above_zero(write, body, scale):
    with pytest.raises(InputError, match='entry 0: "scale" must be a number above 0'):
        read_handles(write([{"vertices": [5], "scale": scale}]), body)


def test_a_scale_excludes_targets(write, body):
    with pytest.raises(InputError, match='give the motion either as "target" or as "scale"'):
        read_handles(write([{"vertices": [5], "scale": 2, "target": [[0, 0, 0]]}]), body)

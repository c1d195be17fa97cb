import json
from pathlib import Path

import numpy as np
import pytest

from sshade import Handles, InputError, Mesh, deform
from sshade.io.handles import read_handles, read_task, write_handles
from sshade.io.meshes import write_mesh
from sshade.mesh.surface import surface
from tests.shapes import bumpy, rotation, tetrahedron


@pytest.fixture
def write(tmp_path):
    """Write handle entries, or any text, to a JSON file."""

    def _write(content, name: str = "pose.json") -> Path:
        text = content if isinstance(content, str) else json.dumps({"handles": content})
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return _write


def test_handles_by_vertex_are_taken_exactly(write, body):
    entries = [
        {"landmark": "foot", "kind": "static", "vertices": [7, 3]},
        {"landmark": "hand", "kind": "dynamic", "vertices": [50, 40], "target": [[1, 2, 3], [4, 5, 6]]},
    ]
    handles = read_handles(write(entries), body)
    assert handles.index.tolist() == [7, 3, 50, 40]
    assert np.array_equal(handles.target, [*body.V[[7, 3]], [1, 2, 3], [4, 5, 6]])
    assert handles.dynamic.tolist() == [False, False, True, True]
    assert handles.group.tolist() == [0, 0, 1, 1]


def test_handles_by_position_are_snapped_as_positions_are(write, body):
    rng = np.random.default_rng(0)
    foot = body.V[[10, 11]] + 1e-3
    hand = body.V[[200, 201, 202]] + rng.normal(scale=1e-3, size=(3, 3))
    moved = hand @ rotation(1).T + [1, 0, 0]
    entries = [
        {"kind": "static", "source": foot.tolist(), "target": (foot + 1).tolist()},
        {"kind": "dynamic", "source": hand.tolist(), "target": moved.tolist()},
    ]
    handles = read_handles(write(entries), body)
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


def test_the_kind_follows_from_the_target_where_it_is_left_out(write, body):
    entries = [{"vertices": [1]}, {"vertices": [2], "target": [[0, 0, 0]]}]
    assert read_handles(write(entries), body).dynamic.tolist() == [False, True]


def test_a_region_is_all_vertices_in_its_boxes_and_moves_rigidly(write, body):
    V = body.V
    low, high = V.min(axis=0), V.max(axis=0)
    bottom = [low.tolist(), [*high[:2], low[2] + 0.5]]
    side = [[high[0] - 0.2, *low[1:]], high.tolist()]
    top = [[*low[:2], V[7, 2]], high.tolist()]  # vertex 7 lies in the side of the box
    R, t = rotation(2), [1.0, 2.0, 3.0]
    entries = [
        {"kind": "static", "boxes": [bottom, side], "rotation": R.tolist(), "translation": t},
        {"boxes": [top], "rotation": R.tolist(), "translation": t},
    ]
    in_first = (V[:, 2] <= low[2] + 0.5) | (V[:, 0] >= high[0] - 0.2)
    for raw in (False, True):
        alone = read_handles(write(entries[:1]), body, raw=raw)
        assert np.array_equal(alone.index, np.flatnonzero(in_first)) and not alone.dynamic.any()
        target = V[in_first] @ R.T + t if raw else V[in_first]
        assert np.allclose(alone.target, target, rtol=0, atol=1e-14)
    moved = read_handles(write(entries[1:]), body)
    assert 7 in moved.index and moved.dynamic.all()
    assert np.array_equal(moved.index, np.flatnonzero(V[:, 2] >= V[7, 2]))
    assert np.allclose(moved.target, V[moved.index] @ R.T + t, rtol=0, atol=1e-14)
    with pytest.raises(InputError, match="has contradictory targets"):  # the side meets the top
        read_handles(write(entries), body)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"boxes": [[[9, 9, 9], [10, 10, 10]]]}, "entry 0: no vertex lies in its boxes"),
        ({"boxes": [[[0, 0, 0]]]}, '"boxes" must be a list of pairs of points'),
        ({"boxes": [[[0, 0, 0], [1, 1, float("nan")]]]}, '"boxes" has a NaN or infinite position'),
        ({"rotation": [[1, 0], [0, 1]]}, '"rotation" must be three rows of three numbers'),
        ({"rotation": [[2, 0, 0], [0, 1, 0], [0, 0, 1]]}, '"rotation" is no rotation'),
        ({"translation": [[0, 0, 0]]}, '"translation" must be three numbers'),
        ({"vertices": [1]}, 'either as "vertices", as "source" or as "boxes"'),
        ({"rotation": ...}, 'entry 0: it is dynamic and has no "rotation"'),
        ({"translation": ...}, 'entry 0: it is dynamic and has no "translation"'),
    ],
)
def test_a_wrong_region_is_refused(write, body, change, message):
    entry = {"boxes": [[[-9, -9, -9], [9, 9, 9]]], "rotation": np.eye(3).tolist(), "translation": [0, 0, 0]}
    assert len(read_handles(write([entry]), body)) == body.n
    changed = {key: value for key, value in (entry | change).items() if value is not ...}
    with pytest.raises(InputError, match=message):
        read_handles(write([changed]), body)


def test_unused_groups_are_skipped_and_group_numbers_count_entries(write, body):
    entries = [
        {"kind": "unused", "vertices": [10**9], "source": "nonsense"},
        {"kind": "static", "vertices": [4], "delta": 0.1, "anything": None},
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
    handles = Handles(index, target, dynamic=dynamic, group=rng.integers(0, 3, 9))
    write_handles(tmp_path / "a.json", handles)
    back = read_handles(tmp_path / "a.json", body)
    a, b = np.argsort(handles.index), np.argsort(back.index)
    for name in ("index", "target", "dynamic"):
        assert np.array_equal(getattr(handles, name)[a], getattr(back, name)[b])
    # Groups are renumbered, one for each kind in each: equal before means equal or split after.
    pairs = set(zip(handles.group[a] * 2 + handles.dynamic[a], back.group[b], strict=True))
    assert len(pairs) == len({p[0] for p in pairs}) == len({p[1] for p in pairs})
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


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
    """Another unit of length, far from the origin."""
    mesh = bumpy(3)
    return Mesh(170 * mesh.V + [300, -50, 20], mesh.F)


class Experiment:
    """A folder of Implicit-ARAP, in its coordinates: other axes, centred at the centroid, scaled to 0.8."""

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
    """As of another copy of the model: handles are vertices, and targets those vertices moved rigidly."""
    experiment = Experiment(tmp_path / "x", far_body, AXES[2], noise=0.003)
    handles = read_handles(experiment.path, far_body)
    static = ~handles.dynamic
    assert np.array_equal(handles.target[static], far_body.V[handles.index[static]])
    at, to = far_body.V[handles.index[handles.dynamic]], handles.target[handles.dynamic]
    # Rigid: all distances among the targets are those among their vertices.
    rest, apart = (np.linalg.norm(x[:, None] - x[None], axis=2) for x in (at, to))
    assert np.allclose(apart, rest, rtol=0, atol=1e-9 * far_body.diagonal)
    assert np.linalg.norm(to.mean(axis=0) - experiment.moved.mean(axis=0)) < 0.05 * far_body.diagonal


def test_a_little_rigid_motion_of_another_copy_is_found_by_icp(tmp_path, far_body):
    """The centroid of another triangulation lies elsewhere: all points are off by the same shift."""
    experiment = Experiment(tmp_path / "x", far_body, AXES[3])
    everywhere = np.random.default_rng(0).permutation(far_body.n)[:200]
    shift, up = np.array([0.006, -0.004, 0.005]), np.array([0, 0, 0.5])
    points = experiment.to_file(far_body.V[everywhere]) + shift
    experiment.put("parts", "all", points)
    experiment.put("transforms", "moved", points + up)
    experiment.path.write_text("handles: {moving: {positions: [all], transform: [moved]}}")
    handles = read_handles(experiment.path, far_body, raw=True)
    # Raw targets are the file's, mapped: without ICP all would be off by the whole shift.
    target = far_body.V + up @ experiment.axes / experiment.scale
    gap = np.linalg.norm(handles.target - target[handles.index], axis=1)
    assert np.max(gap) < 0.75 * np.linalg.norm(shift) / experiment.scale


def test_static_or_moving_parts_may_be_missing(tmp_path, far_body):
    path = Experiment(tmp_path / "x", far_body, AXES[0]).path
    path.write_text("handles: {static: {positions: [foot]}}")
    assert not read_handles(path, far_body).dynamic.any()
    path.write_text("handles: {moving: {positions: [hand], transform: [hand_up]}, static: }")
    assert read_handles(path, far_body).dynamic.all()


def test_a_task_is_made_of_what_of_a_file_is_a_surface(tmp_path):
    """An unused vertex first, a face that repeats a vertex, and a second body that has no handle."""
    body = bumpy(1)
    V = np.concatenate([[[9.0, 9, 9]], body.V, body.V + 5])
    F = np.concatenate([body.F + 1, [[1, 1, 2]], body.F + 1 + body.n])
    write_mesh(tmp_path / "bodies.ply", V, F)
    write_handles(tmp_path / "pose.json", Handles([1, 5], V[[1, 5]]))
    files = tmp_path / "bodies.ply", tmp_path / "pose.json"
    with pytest.raises(InputError, match="1 of the mesh's 2 components have no handle"):
        read_task(str(files[0]), handles=str(files[1]))
    task = read_task(str(files[0]), handles=str(files[1]), carry_unconstrained=True)
    assert np.array_equal(task.mesh.V, V[1:]) and task.handles.index.tolist() == [0, 4]
    result = deform(task, vertices=30)
    assert result.extra["unconstrained"] == 1 and np.abs(result.vertices - V[1:]).max() < 1e-6

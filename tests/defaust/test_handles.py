"""Choice of handles against brute force, and the Delta rule by hand."""

import heapq

import numpy as np
import pytest

from defaust.build.handles import choose_handles, displacement, handle_records, nearest_vertices
from defaust.sources.synthetic import SyntheticBodies
from sshade import InputError, Mesh


def grid(size: int) -> Mesh:
    """A bumpy square of size x size vertices with irrational edge lengths."""
    x, y = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
    V = np.stack([x, y, 0.3 * np.sin(1.7 * x + y**2)], axis=-1).reshape(-1, 3).astype(float)
    V[:, :2] += 0.05 * np.random.default_rng(0).normal(size=(size * size, 2))
    i = (np.arange(size - 1)[:, None] * size + np.arange(size - 1)).ravel()
    a, b, c, d = i, i + size, i + size + 1, i + 1
    return Mesh(V, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def naive_distances(mesh: Mesh, start: int) -> np.ndarray:
    neighbours = {i: [] for i in range(mesh.n)}
    for i, j in mesh.edges.tolist():
        length = float(np.linalg.norm(mesh.V[i] - mesh.V[j]))
        neighbours[i].append((j, length))
        neighbours[j].append((i, length))
    distance = np.full(mesh.n, np.inf)
    heap = [(0.0, start)]
    while heap:
        d, i = heapq.heappop(heap)
        if d < distance[i]:
            distance[i] = d
            for j, length in neighbours[i]:
                heapq.heappush(heap, (d + length, j))
    return distance


def test_nearest_vertices_against_brute_force():
    mesh = grid(12)
    near = nearest_vertices(mesh, 40, count=30)
    expected = np.argsort(naive_distances(mesh, 40), kind="stable")[:30]
    np.testing.assert_array_equal(near, expected)
    assert near[0] == 40


def test_nearest_vertices_are_too_few():
    mesh = grid(3)
    with pytest.raises(InputError, match="only 9 vertices can be reached from vertex 0"):
        nearest_vertices(mesh, 0, count=10)


def test_handles_are_near_distinct_and_reproducible():
    source = SyntheticBodies()
    rest = source.rest(1)
    landmarks = source.landmark_vertices(1)
    chosen = choose_handles(rest, landmarks, subject=1, seed=0)
    everything = np.concatenate(list(chosen.values()))
    assert len(np.unique(everything)) == len(everything) == 30 * len(landmarks)
    for name, index in chosen.items():
        assert np.isin(index, nearest_vertices(rest, landmarks[name], count=60)).all()
    for options, same in (
        ({"subject": 1, "seed": 0}, True),
        ({"subject": 1, "seed": 1}, False),
        ({"subject": 2, "seed": 0}, False),
    ):
        again = choose_handles(rest, landmarks, **options)
        assert all(np.array_equal(again[name], chosen[name]) for name in chosen) == same


def test_overlapping_landmarks_share_no_vertex():
    mesh = grid(12)
    chosen = choose_handles(mesh, {"a": 65, "b": 66}, subject=0, seed=0, per_landmark=20, neighbourhood=40)
    assert not set(chosen["a"]) & set(chosen["b"])
    with pytest.raises(InputError, match="'b' has .* left that no other landmark took, and needs 30"):
        choose_handles(mesh, {"a": 65, "b": 65}, subject=0, seed=0, per_landmark=30, neighbourhood=40)


def test_delta_by_hand():
    source = np.zeros((3, 3))
    target = np.array([[3.0, 4.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    d = displacement(source, target, diagonal=39.0)
    assert (d.delta, d.delta_mean, d.kind) == (6.0, 2.0, "dynamic")  # 2 >= 0.05 * 39 = 1.95
    assert displacement(source, target, diagonal=41.0).kind == "static"  # 2 < 2.05
    assert displacement(source, target, diagonal=41.0, static_below=0.04).kind == "dynamic"


def test_records_of_a_pose():
    mesh = grid(6)
    posed = mesh.V.copy()
    posed[:, 2] += np.where(mesh.V[:, 0] > 2.5, 100.0, 0.0)
    chosen = {"still": np.array([0, 1]), "moving": np.array([34, 35]), "absent": np.array([12, 13])}
    still, moving, absent = handle_records(mesh, posed, chosen=chosen, used=("still", "moving"))
    assert (still["kind"], still["delta"]) == ("static", 0.0)
    assert moving["kind"] == "dynamic"
    assert (moving["delta"], moving["delta_mean"]) == (200.0, 100.0)
    np.testing.assert_array_equal(moving["source"], mesh.V[[34, 35]])
    np.testing.assert_array_equal(moving["target"], posed[[34, 35]])
    assert absent == {
        "landmark": "absent", "kind": "unused", "delta": None, "delta_mean": None, "source": [], "target": []
    }  # fmt: skip

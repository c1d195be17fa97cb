"""Vertices of a mesh as handles: tasks, results, snapping, and handles that do not fit together."""

from dataclasses import fields

import numpy as np
import pytest

from sshade import DeformationResult, DeformationTask, Handles, InputError, Mesh, TransferTask
from sshade.problem import snapping
from sshade.problem.snapping import snap_to_vertices
from tests.refusals import refusals
from tests.shapes import bumpy, icosphere, rotation, strip, tetrahedron, torus

TETRAHEDRON, TURNS = tetrahedron(), np.stack([np.eye(3), rotation(1)])
TURNED = Mesh(TETRAHEDRON.V, TETRAHEDRON.F[::-1])
ONE, PLACES = Handles([0], TETRAHEDRON.V[:1]), np.eye(3)[:2]


APART = {
    "guess has shape": lambda: DeformationTask("t", TETRAHEDRON, ONE, guess=np.eye(3)),
    "other faces": lambda: TransferTask("t", TETRAHEDRON, TURNED, TETRAHEDRON.V),
    "2 handles": lambda: Handles.from_positions(TETRAHEDRON, np.eye(3)[:2], np.eye(3)[:1]),
}

test_tasks_and_results_that_do_not_correspond_are_refused = refusals(APART)


def test_a_task_is_at_rest_if_no_handle_moves_or_turns():
    rest = np.array(TETRAHEDRON.V[:2])
    at_rest = [
        DeformationTask("t", TETRAHEDRON, Handles([0, 1], rest + shift, rotation=turns)).is_at_rest
        for shift in (0.0, 1e-12, 0.1)
        for turns in (None, TURNS)
    ]
    assert at_rest == [True, False, True, False, False, False]


def test_a_soft_handle_pulls_where_its_faces_have_no_area():
    mesh = bumpy(2)
    V = np.array(mesh.V)
    V[np.unique(mesh.F[(mesh.F == 7).any(axis=1)])] = V[7]
    task = DeformationTask("t", Mesh(V, mesh.F), Handles([7, 90], V[[7, 90]], weight=1.0))
    assert task.mesh.vertex_areas[7] == 0 < task.handles.portion.min()


def test_other_types_and_results_that_are_not_finite_are_errors():
    with pytest.raises(TypeError, match="not a tuple"):
        DeformationTask("t", (TETRAHEDRON.V, TETRAHEDRON.F), ONE)
    with pytest.raises(TypeError, match="takes Handles, not a list"):
        DeformationTask("t", TETRAHEDRON, [0])
    with pytest.raises(FloatingPointError, match="1 deformed vert"):
        DeformationResult(np.array([np.nan, 1]), 1, True)


def test_repeated_ids_with_one_target_are_kept_once_in_order():
    target = np.array([[1.0, 2, 3], [4, 5, 6], [1 + 1e-15, 2, 3], [7, 8, 9]])
    handles = Handles([8, 3, 8, 5], target, dynamic=[True, False, True, True], group=[0, 1, 2, 3])
    assert handles.index.tolist() == [8, 3, 5] and handles.hard.all() and handles.snapping.merged == 0
    names = ["index", "target", "dynamic", "group", "weight", "rotation"]
    assert [field.name for field in fields(handles)] == names
    assert repr(handles) == "<Handles: 3 vertices, 2 of them moved>"
    assert np.array_equal(handles.target, target[[0, 1, 3]])
    assert handles.dynamic.tolist() == [True, False, True] and handles.group.tolist() == [0, 1, 3]


def two(index=(0, 1), target=PLACES, **more) -> Handles:
    return Handles(index, target, **more)


INCONSISTENT = {
    "no handles": lambda: two([], np.zeros((0, 3))),
    "integers": lambda: two([0.5], np.zeros((1, 3))),
    r"targets of shape \(2, 3\), not \(2, 2\)": lambda: two(target=np.zeros((2, 2))),
    r"handle 1 \(vertex 6\) is NaN": lambda: two([5, 6], [[0, 0, 0], [np.nan, 0, 0]]),
    "`dynamic` of shape": lambda: two(dynamic=[True]),
    "`dynamic` must be numbers": lambda: two(dynamic=["no", "yes"]),
    "`dynamic` must be True or False, not 2": lambda: two(dynamic=[0, 2]),
    "`group` must be whole numbers, not 0.2": lambda: two(group=[0.2, 1.2]),
    "`group` must be whole numbers, not nan": lambda: two(group=[np.nan, 1]),
    "vertex 4 has two weights": lambda: two([4, 4], np.zeros((2, 3)), weight=[1, 2]),
    "vertex 4 has two rotations": lambda: two([4, 4], np.zeros((2, 3)), rotation=TURNS),
    "vertex 4 has contradictory targets, 1.41 apart": lambda: two([4, 4]),
    "contradictory targets in groups 0 and 3": lambda: two([4, 4], group=[0, 3]),
}

test_inconsistent_handles_are_refused = refusals(INCONSISTENT)


def test_dynamic_handles_carry_the_snap_offset_turned_by_their_groups_rotation(body):
    ids = np.arange(40, 48)
    turns = [rotation(3), rotation(4)]
    source = body.V[ids] + np.random.default_rng(0).normal(scale=1e-3, size=(8, 3))
    target = np.concatenate([source[:4] @ turns[0].T + [1, 0, 0], source[4:] @ turns[1].T - [0, 1, 0]])
    handles = Handles.from_positions(body, source, target, group=np.repeat([7, 2], 4))
    fixed = Handles.from_positions(body, source, target, dynamic=False)
    assert np.array_equal(fixed.target, body.V[fixed.index]) and not fixed.dynamic.any()
    # Each group moves rigidly, so that its vertices move by the same motion as its positions.
    expected = {int(v): body.V[v] @ turns[0].T + [1, 0, 0] for v in ids[:4]}
    expected |= {int(v): body.V[v] @ turns[1].T - [0, 1, 0] for v in ids[4:]}
    assert set(handles.index.tolist()) == set(expected)
    for vertex, target, group in zip(handles.index, handles.target, handles.group, strict=True):
        assert np.allclose(target, expected[int(vertex)], rtol=0, atol=1e-12 * body.diagonal)
        assert group == (7 if vertex < 44 else 2)


def test_handles_of_a_group_on_one_vertex_are_merged_to_their_mean():
    mesh = tetrahedron()
    source = np.array([[0.95, 0, 0], [1.05, 0, 0], [0, 1, 0]])
    handles = Handles.from_positions(mesh, source, source + [0, 0, 2], group=[4, 4, 4])
    assert handles.index.tolist() == [1, 2] and handles.snapping.merged == 1
    assert np.allclose(handles.target, [[1, 0, 2], [0, 1, 2]], rtol=0, atol=1e-14)
    assert handles.snapping.distance == pytest.approx([0.05, 0.0])
    target = [[1, 0, 0], [3, 0, 0], [0, 0, 9]]
    raw = Handles.from_positions(mesh, source, target, raw=True, strict=False)
    assert raw.target.tolist() == [[2, 0, 0], [0, 0, 9]] and raw.snapping.merge_distance == 1
    with pytest.raises(InputError, match="2 positions of group 0 .* vertex, 1, and contradictory targets"):
        Handles.from_positions(mesh, source, target, raw=True)


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda s: 1000 * s, "times 0.001 they would be on it, in another unit"),
        (lambda s: s / 1000, "times 1000 they would be on it"),
        (lambda s: s * 1000 / 25.4, "times 0.0254 they would"),
        (lambda s: s + [5, 0, 0], "their box has a diagonal of .*, that of the mesh .*; give"),
        (lambda s: np.concatenate([s[:-1], s[-1:] + [9, 0, 0]]), "1 of 10 .*: mend or remove these"),
    ],
)
def test_handles_far_from_the_mesh_are_refused_with_the_likely_cause(body, change, cause):
    source = change(body.V[::70] + 1e-3)
    with pytest.raises(InputError, match=r"handle \d of group 0 is .* times the mesh's diagonal; .*" + cause):
        Handles.from_positions(body, source, source)
    far = np.array(body.V[:6]) - [[0, 0, 100]] * np.array([[0], [0], [0], [0], [1], [0]])
    with pytest.raises(InputError, match="handle 1 of group 7 is 9"):
        Handles.from_positions(body, far, far, group=[0, 7, 0, 0, 7, 7])


def test_handles_snap_within_a_few_per_cent_of_the_diagonal(body):
    lowest = body.V[[np.argmin(body.V[:, 2])]]
    near, far = (lowest - [0, 0, fraction * body.diagonal] for fraction in (0.049, 0.051))
    found = Handles.from_positions(body, near, near)
    assert found.snapping.distance == pytest.approx([0.049 * body.diagonal])
    with pytest.raises(InputError, match="farther than 0.05 times it"):
        Handles.from_positions(body, far, far)
    # On a coarse mesh a point of a face may be farther from its corners.
    assert len(Handles.from_positions(icosphere(0), [[0.4, 0.4, 0.4]], [[0, 0, 0]])) == 1


def test_handles_at_other_targets_equal_new_ones():
    index, group, weight = np.array([4, 2, 9]), np.array([0, 1, 1]), np.array([np.inf, 2.0, 3.0])
    turn = np.full((3, 3, 3), np.nan)
    turn[1] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    rest = Handles(index, np.zeros((3, 3)), group=group, weight=weight)
    target = np.arange(9.0).reshape(3, 3)
    moved, new = rest.at(target, turn), Handles(index, target, group=group, weight=weight, rotation=turn)
    target[0] = 7.0  # `at` has taken a copy
    for name in ("index", "target", "dynamic", "group", "weight", "rotation"):
        np.testing.assert_array_equal(getattr(moved, name), getattr(new, name))
        assert not getattr(moved, name).flags.writeable
    assert not rest.target.any() and moved.at(target).rotation is None
    for wrong in ((np.zeros((2, 3)),), (np.full((3, 3), np.nan),), (target, np.full((3, 3, 3), 2.0))):
        with pytest.raises(InputError):
            rest.at(*wrong)


SHAPES = {"bumpy": bumpy(4), "flat": strip(60, 40), "torus": torus(90, 30)}


@pytest.fixture(params=[1, 5, 10**9])
def large(request, monkeypatch):
    """From all vertices through a few to a mesh that is not large."""
    monkeypatch.setattr(snapping, "LARGE", 0 if request.param < 10**9 else 10**9)
    monkeypatch.setattr(snapping, "STRIDE", request.param)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("off", [0.0, 1e-3, 0.04])
def test_nearest_vertices_are_those_of_all_distances(name, off, large):
    mesh, rng = SHAPES[name], np.random.default_rng(7)
    source = mesh.V[rng.permutation(mesh.n)[:40]] + off * mesh.diagonal * rng.uniform(-0.5, 0.5, (40, 3))
    distance, index = snap_to_vertices(mesh, source, np.zeros(40, dtype=int))
    every = np.linalg.norm(mesh.V[None] - source[:, None], axis=2)
    assert np.array_equal(index, every.argmin(axis=1))
    np.testing.assert_allclose(distance, every.min(axis=1), rtol=1e-12, atol=1e-300)


def test_one_position_outside_of_the_box(large):
    mesh = SHAPES["bumpy"]
    source = mesh.V[[np.argmin(mesh.V[:, 0])]] - [0.03 * mesh.diagonal, 0, 0]
    _, index = snap_to_vertices(mesh, source, np.zeros(1, dtype=int))
    assert index[0] == np.argmin(np.linalg.norm(mesh.V - source, axis=1))

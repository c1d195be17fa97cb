"""`deform`: all forms of the call, meshes that are not clean, faces without area, and refusals."""

from functools import partial

import numpy as np
import pytest
import pyvista
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from baselines.accelerated import local_global
from sshade import DeformationTask, Handles, InputError, Mesh, deform
from sshade.solver.laplacian import SLACK, half_cotangents
from tests.shapes import QUARTER, beside, bumpy, end_handles, held_ends, rotation, shifted, torn
from tests.sshade.method.calls import fast, fine, paper

BODY = bumpy(2)
POSE = end_handles(BODY.V, count=8, shift=(0.3, 0, 0.2))
B, BC = POSE.index, POSE.target
TASK = DeformationTask("body", BODY, Handles(B, BC))
PAIR = beside(BODY, shifted(BODY, 20))
TRIMESH = trimesh.Trimesh(BODY.V, BODY.F, process=False)


@pytest.mark.parametrize(("method", "farthest"), [("paper", 4e-4), ("fast", 3e-3)])
def test_a_result_is_near_the_minimum(method, farthest):
    """2e-4 and 1e-3 of the diagonal are left, and nine times as much with ten times the tolerance."""
    task = held_ends(bumpy(4))
    found = deform(task, method=method, samplings=1)
    exact = deform(task, method=method, samplings=1, tolerance=1e-8, max_iterations=9999)
    assert found.converged and exact.converged
    assert np.linalg.norm(found.vertices - exact.vertices, axis=1).max() < farthest * task.mesh.diagonal


def test_a_trimesh_keeps_its_colours_texture_and_metadata():
    uv = BODY.V[:, :2].copy()
    given = trimesh.Trimesh(BODY.V, BODY.F, process=False, visual=trimesh.visual.TextureVisuals(uv=uv))
    given.metadata["name"] = "body"
    before, normals = given.vertices.copy(), given.vertex_normals.copy()
    result = deform(given, B, BC, vertices=60)
    assert type(result) is trimesh.Trimesh and result is not given
    assert np.array_equal(result.visual.uv, uv) and result.metadata["name"] == "body"
    assert np.array_equal(given.vertices, before) and np.abs(result.vertex_normals - normals).max() > 0.01


def in_scene(*bodies, transform: np.ndarray | None = None) -> trimesh.Scene:
    scene = trimesh.Scene()
    for number, body in enumerate(bodies):
        scene.add_geometry(body, geom_name=f"body {number}", transform=transform)
    return scene


def test_a_scene_of_a_glb_is_deformed_where_its_node_puts_the_mesh(tmp_path):
    transform = np.eye(4)
    transform[:3] = np.column_stack([3 * rotation(4), [5, -2, 1]])
    R, t = transform[:3, :3], transform[:3, 3]
    in_scene(TRIMESH, transform=transform).export(tmp_path / "body.glb")
    scene = trimesh.load(tmp_path / "body.glb", process=False)
    rest = scene.dump()[0].vertices.copy()
    result = deform(scene, B, BC @ R.T + t, vertices=60)
    assert type(result) is trimesh.Scene and result is not scene
    assert np.array_equal(scene.dump()[0].vertices, rest)
    expected = deform(rest, BODY.F, B, BC @ R.T + t, vertices=60)
    np.testing.assert_allclose(result.dump()[0].vertices, expected, rtol=0, atol=1e-9)
    (name,) = result.geometry
    places = [one.graph[one.graph.nodes_geometry[0]][0] for one in (result, scene)]
    assert np.array_equal(*places)
    np.testing.assert_allclose(result.geometry[name].vertices[B], BC, rtol=0, atol=1e-5)


def test_a_polydata_of_triangles_keeps_its_arrays_and_turns_its_normals():
    given = pyvista.PolyData.from_regular_faces(BODY.V, BODY.F)
    given["number"] = np.arange(BODY.n)
    given = given.compute_normals(split_vertices=False, consistent_normals=False, auto_orient_normals=False)
    before = given.points.copy()
    result = deform(given, B, BC, vertices=60)
    assert type(result) is pyvista.PolyData and np.array_equal(given.points, before)
    assert np.array_equal(result.points, deform(before, BODY.F, B, BC, vertices=60))
    assert np.array_equal(result["number"], np.arange(BODY.n))
    for data, old in ((result.point_data, given.point_data), (result.cell_data, given.cell_data)):
        normals = data.active_normals
        assert normals.dtype == old.active_normals.dtype and not np.allclose(normals, old.active_normals)
    faces = Mesh(result.points, BODY.F).face_normals
    assert np.allclose(result.cell_data.active_normals, faces, atol=1e-5)
    assert ((result.point_data.active_normals[BODY.F[:, 0]] * faces).sum(axis=1) > 0.7).all()


@pytest.mark.parametrize("kind", ["triangles", "cubes", "structured"])
def test_a_grid_of_pyvista_is_deformed_by_its_outer_surface(kind):
    if kind == "triangles":
        given = pyvista.PolyData.from_regular_faces(BODY.V, BODY.F).cast_to_unstructured_grid()
    else:
        grid = pyvista.ImageData(dimensions=(5, 5, 9))
        given = grid.cast_to_unstructured_grid() if kind == "cubes" else grid.cast_to_structured_grid()
    given.point_data["heat"] = np.arange(given.n_points)
    rest = np.array(given.points)
    b = np.flatnonzero((rest[:, 2] < rest[:, 2].min() + 1e-6) | (rest[:, 2] > rest[:, 2].max() - 1e-6))
    bc = rest[b] + np.outer(rest[b, 2] > rest[:, 2].mean(), [1.0, 0, 0])
    result = deform(given, b, bc)
    assert type(result) is type(given) and np.array_equal(given.points, rest)
    assert np.allclose(result.points[b], bc, atol=1e-6) and np.array_equal(result["heat"], given["heat"])
    with pytest.raises(InputError, match=r"a ImageData has no points of its own; pass its .cast_to"):
        deform(pyvista.ImageData(dimensions=(2, 2, 2)), b, bc)


def unclean() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return BODY with an unused first vertex, a doubled seam, a duplicate face and a degenerate face."""
    V, F, seam = torn(BODY)
    return V, np.concatenate([F, F[:1], [[1, 1, 2]]]), seam


def test_whether_handles_move_does_not_depend_on_the_unit():
    for unit in (1e-15, 1.0, 1e15):
        mesh = Mesh(unit * BODY.V, BODY.F)
        still, moved = (DeformationTask("t", mesh, Handles(B, unit * target)) for target in (BODY.V[B], BC))
        assert still.is_at_rest and not moved.is_at_rest


def test_what_is_no_part_of_the_surface_stays_and_seams_move_as_one():
    V, F, seam = unclean()
    U = deform(V, F, B + 1, BC, vertices=60)
    assert np.array_equal(U[0], V[0])
    assert np.array_equal(U[1 + BODY.n :], U[seam])
    # The faces may have another order, because a copy may replace the original. Only rounding differs.
    assert np.abs(U[1 : BODY.n + 1] - deform(BODY, B, BC, vertices=60).V).max() < 1e-9 * BODY.diagonal


ROUND, SMALL = bumpy(3), bumpy(2)
ALL = {"sshade": partial(paper, samplings=2), "fast": fast, "fine": fine, "full resolution": local_global}


def flattened(seed: int) -> Mesh:
    """Move a corner of some faces of SMALL onto the opposite edge, at an end or between the ends."""
    rng = np.random.default_rng(seed)
    a, b, c = SMALL.F[rng.choice(SMALL.m, SMALL.m // 8, replace=False)].T
    share = rng.choice([0.0, 1.0, 0.3, 0.5], len(a))[:, None]
    V = SMALL.V.copy()
    V[a] = V[b] + share * (V[c] - V[b])
    return Mesh(V, SMALL.F)


def posed(mesh: Mesh, n: int) -> DeformationTask:
    """Return a task with handles at both ends along z, chosen from the first n vertices."""
    return DeformationTask("ends", mesh, end_handles(mesh.V[:n], turn=QUARTER, shift=[0, 0, 0.2]))


def check_collapsed(method):
    """Assert that coincident vertices stay together, and that distant vertices move as in a sound mesh."""
    rng = np.random.default_rng(3)
    V = np.array(ROUND.V)
    picked = ROUND.F[rng.choice(np.flatnonzero((np.abs(V[ROUND.F][:, :, 2]) < 1).all(axis=1)), 12)]
    V[picked[:6, 1]] = V[picked[:6, 0]]
    V[picked[6:, 1:]] = V[picked[6:, :1]]
    mesh = Mesh(V, ROUND.F)
    sound, flat = (method(posed(m, ROUND.n)) for m in (ROUND, mesh))
    a, b = mesh.edges[np.linalg.norm(V[mesh.edges[:, 0]] - V[mesh.edges[:, 1]], axis=1) == 0].T
    assert len(a) > 15
    assert np.linalg.norm(flat.vertices[a] - flat.vertices[b], axis=1).max() < 0.005 * mesh.diagonal
    far = np.setdiff1d(np.arange(ROUND.n), ROUND.F[mesh.without_area])
    assert np.linalg.norm((sound.vertices - flat.vertices)[far], axis=1).max() < 0.03 * mesh.diagonal
    return flat, mesh.without_area.sum()


@pytest.mark.parametrize("name", ALL)
def test_every_method_takes_collapsed_edges_and_faces(name):
    flat, count = check_collapsed(ALL[name])
    if name != "full resolution":
        assert flat.facts.faces_without_area == count > 12


@given(seed=st.integers(0, 2**32 - 1))
def test_half_cotangents_are_bounded_and_those_of_sound_faces_stay(seed):
    flat = flattened(seed)
    h = half_cotangents(flat)
    assert np.abs(h).max() <= 0.5 / SLACK + 1
    sound = ~flat.without_area
    used, F = np.unique(flat.F[sound], return_inverse=True)
    alone = Mesh(flat.V[used], F.reshape(-1, 3))
    assert np.array_equal(h[sound], half_cotangents(alone))
    # The sum of h e e^T over a face is not negative for any edges e that close, as in a real triangle.
    u = np.random.default_rng(0).normal(size=(50, 3))
    squared = (u - np.roll(u, -1, axis=1)) ** 2
    assert (squared @ h.T).min() > -1e-9 * np.abs(h).max()

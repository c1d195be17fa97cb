"""`deform`: all forms of the call give the same result, keep their input, and accept unclean meshes."""

from functools import partial

import numpy as np
import pytest
import pyvista
import trimesh

import sshade
from baselines.accelerated import local_global
from sshade import DeformationResult, DeformationTask, Handles, InputError, Mesh, bind, deform
from tests.shapes import as_obj, beside, bumpy, end_handles, rotation, shifted, torn
from tests.sshade.method.calls import METHODS, fast

BODY = bumpy(2)
POSE = end_handles(BODY.V, count=8, shift=(0.3, 0, 0.2))
B, BC = POSE.index, POSE.target
TASK = DeformationTask("body", BODY, Handles(B, BC))


@pytest.mark.parametrize("name", METHODS)
def test_all_forms_give_what_the_method_gives(name):
    expected = METHODS[name](TASK, vertices=60, seed=2)
    options = {"method": name, "vertices": 60, "seed": 2}
    result = deform(TASK, **options)
    assert isinstance(result, DeformationResult) and result.iterations == expected.iterations
    U = deform(BODY.V.tolist(), BODY.F.tolist(), B.tolist(), BC.tolist(), **options)
    mesh = deform(BODY, B, BC, **options)
    scene = deform(trimesh.Trimesh(BODY.V, BODY.F, process=False), B, BC, **options)
    assert type(mesh) is Mesh and np.array_equal(mesh.F, BODY.F) and type(scene) is trimesh.Trimesh
    for V in (result.vertices, U, mesh.V, scene.vertices):
        assert np.array_equal(V, expected.vertices)


def test_the_default_is_fast_and_a_function_is_taken():
    assert np.array_equal(deform(BODY, B, BC).V, fast(TASK).vertices)
    method = partial(local_global, stiffness=0.5)
    U = deform(BODY.V, BODY.F, B, BC, method=method, max_iterations=20)
    assert np.array_equal(U, local_global(TASK, stiffness=0.5, max_iterations=20).vertices)


@pytest.mark.parametrize(
    ("returned", "error"),
    [
        (None, "the method returned NoneType, not a DeformationResult"),
        (DeformationResult(BODY.V[1:], 0, True), r"vertices of shape \(\d+, 3\) for"),
    ],
)
def test_a_function_that_returns_no_result_of_the_mesh_is_refused(returned, error):
    with pytest.raises((TypeError, ValueError), match=error):
        deform(BODY, B, BC, method=lambda task: returned)
    with pytest.raises((TypeError, ValueError), match=error):
        deform(TASK, method=lambda task: returned)


def test_a_trimesh_keeps_its_colours_texture_and_metadata():
    uv = BODY.V[:, :2].copy()
    given = trimesh.Trimesh(BODY.V, BODY.F, process=False, visual=trimesh.visual.TextureVisuals(uv=uv))
    given.metadata["name"] = "body"
    before, normals = given.vertices.copy(), given.vertex_normals.copy()
    result = deform(given, B, BC, vertices=60)
    assert type(result) is trimesh.Trimesh and result is not given
    assert np.array_equal(result.visual.uv, uv) and result.metadata["name"] == "body"
    assert np.array_equal(given.vertices, before) and np.abs(result.vertex_normals - normals).max() > 0.01
    colours = np.arange(4 * BODY.n, dtype=np.uint8).reshape(-1, 4)
    coloured = trimesh.Trimesh(BODY.V, BODY.F, process=False, vertex_colors=colours)
    assert np.array_equal(deform(coloured, B, BC, vertices=60).visual.vertex_colors, colours)


def in_scene(*bodies: trimesh.Trimesh, transform: np.ndarray) -> trimesh.Scene:
    scene = trimesh.Scene()
    for number, body in enumerate(bodies):
        scene.add_geometry(body, geom_name=f"body {number}", transform=transform)
    return scene


@pytest.mark.parametrize("placed", [False, True])
def test_a_scene_of_a_glb_is_deformed_where_its_node_puts_the_mesh(tmp_path, placed):
    transform = np.eye(4)
    if placed:
        transform[:3] = np.column_stack([3 * rotation(4), [5, -2, 1]])
    R, t = transform[:3, :3], transform[:3, 3]
    body = trimesh.Trimesh(BODY.V, BODY.F, process=False)
    in_scene(body, transform=transform).export(tmp_path / "body.glb")
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
    sshade.write(tmp_path / "out.ply", result)
    np.testing.assert_allclose(sshade.read(tmp_path / "out.ply").V, expected, rtol=0, atol=1e-9)


def test_a_scene_of_several_meshes_or_of_none_is_refused():
    body = trimesh.Trimesh(BODY.V, BODY.F, process=False)
    scene = in_scene(body, body, transform=np.eye(4))
    with pytest.raises(InputError, match=r"has 2 meshes; pass scene.to_mesh\(\), .* scene.dump\(\)"):
        deform(scene, B, BC)
    assert len(deform(scene.to_mesh(), [*B, *(B + BODY.n)], [*BC, *BC], vertices=60).vertices) == 2 * BODY.n
    with pytest.raises(InputError, match="has 0 meshes"):
        deform(trimesh.Scene(), B, BC)
    with pytest.raises(InputError, match="is no triangle mesh"):
        deform(in_scene(trimesh.PointCloud(BODY.V), transform=np.eye(4)), B, BC)


def test_a_polydata_of_triangles_keeps_its_arrays_without_old_normals(tmp_path):
    given = pyvista.PolyData.from_regular_faces(BODY.V, BODY.F)
    given["number"] = np.arange(BODY.n)
    given = given.compute_normals(split_vertices=False, consistent_normals=False, auto_orient_normals=False)
    before = given.points.copy()
    result = deform(given, B, BC, vertices=60)
    assert type(result) is pyvista.PolyData and np.array_equal(given.points, before)
    assert np.array_equal(result.points, deform(before, BODY.F, B, BC, vertices=60))
    assert np.array_equal(result["number"], np.arange(BODY.n))
    assert "Normals" in given.array_names and "Normals" not in result.array_names
    sshade.write(tmp_path / "out.ply", result)
    assert np.array_equal(sshade.read(tmp_path / "out.ply").V, result.points)
    with pytest.raises(InputError, match=r"pass its .triangulate\(\)"):
        deform(pyvista.Cube(), [0], [[0, 0, 0]])


def unclean() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return BODY with an unused first vertex, a doubled seam, a duplicate face and a degenerate face."""
    V, F, seam = torn(BODY)
    return V, np.concatenate([F, F[:1], [[1, 1, 2]]]), seam


def test_what_is_no_part_of_the_surface_stays_and_seams_move_as_one():
    V, F, seam = unclean()
    U = deform(V, F, B + 1, BC, vertices=60)
    assert np.array_equal(U[0], V[0])
    assert np.array_equal(U[1 + BODY.n :], U[seam])
    # The faces may have another order, because a copy may replace the original. Only rounding differs.
    assert np.abs(U[1 : BODY.n + 1] - deform(BODY, B, BC, vertices=60).V).max() < 1e-9 * BODY.diagonal


def test_a_frame_function_has_a_value_for_each_vertex_that_is_given():
    V, values = np.concatenate([BODY.V, [[9.0, 9, 9]]]), BODY.V[:, 2]
    options = {"method": "paper", "vertices": 60}
    expected = deform(BODY, B, BC, frame_function=values, **options).V
    found = deform(V, BODY.F, B, BC, frame_function=np.append(values, 0.0), **options)
    np.testing.assert_array_equal(found[:-1], expected)


def test_a_component_without_handles_is_refused_or_follows():
    both = beside(BODY, shifted(BODY, 20))
    with pytest.raises(InputError, match=r"1 of the mesh's 2 components has no handle.*leave --refuse"):
        deform(both.V, both.F, B, BC, refuse_unconstrained=True)
    U = deform(both.V, both.F, B, BODY.V[B] + 1)
    assert np.abs(U - both.V - 1).max() < 1e-12 * both.diagonal


def paper_with(**options):
    return deform(TASK, method="paper", vertices=60, **options)


def loses_a_vertex(task, *, seed, progress=None):
    return DeformationResult(task.mesh.V[1:], iterations=1, converged=True)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: deform(BODY, B), TypeError, "a mesh and 1 more argument was given"),
        (lambda: deform(BODY.V, BODY.F, B), TypeError, "vertices and 2 more arguments"),
        (lambda: deform(TASK, B), TypeError, "a task has handles"),
        (lambda: deform("body.ply", B, BC), TypeError, "'body.ply' is a path; read the file"),
        (lambda: deform(BODY, BODY.V[1:, 0] > 0, BC), InputError, "a mask with a value a vertex, not bool"),
        (lambda: deform(BODY, B, BC[1:]), InputError, r"16 handles need targets of shape \(16, 3\)"),
        (lambda: deform(BODY, B + BODY.n, BC), InputError, "out of range: the mesh has 162"),
        (lambda: deform(BODY, B - 99, BC), InputError, "negative"),
        (lambda: deform(BODY.V[:, :2], BODY.F, B, BC), InputError, r"\(n, 3\)"),
        (lambda: deform(BODY.V, BODY.F + 0.5, B, BC), InputError, "integers"),
        (lambda: paper_with(frame_function="w"), InputError, "'w'"),
        (lambda: paper_with(frame_function=np.full(BODY.n, np.nan)), InputError, "finite"),
        (lambda: paper_with(coarse=loses_a_vertex), InputError, "shape"),
        (lambda: bind(BODY, 60, frames="x"), InputError, "unknown frames"),
        (lambda: deform(*unclean()[:2], [0], BC[:1]), InputError, "handle vertex 0 belongs to no face"),
    ],
)
def test_what_does_not_fit_is_refused(call, error, words):
    with pytest.raises(error, match=words):
        call()


def test_files_are_read_as_arrays_and_written_like_their_source(tmp_path):
    path, out = tmp_path / "body.obj", tmp_path / "posed.obj"
    path.write_text(as_obj(BODY.V, BODY.F))
    V, F = sshade.read(path)
    assert np.array_equal(V, BODY.V) and np.array_equal(F, BODY.F)
    U = deform(V, F, B, BC, vertices=60)
    sshade.write(out, U, like=path)
    assert out.read_text().partition("vt ")[2] == path.read_text().partition("vt ")[2]
    assert np.array_equal(sshade.read(out).V, U)
    for mesh in ((U, F), (Mesh(U, F),), (trimesh.Trimesh(U, F, process=False),)):
        sshade.write(tmp_path / "plain.ply", *mesh)
        again = sshade.read(tmp_path / "plain.ply")
        assert np.array_equal(again.V, U) and np.array_equal(again.F, F)

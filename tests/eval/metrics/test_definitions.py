"""Every measure agrees with its definition, by trimesh, libigl and SciPy, on faces that differ in size."""

from dataclasses import replace
from functools import cache

import igl
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from eval.metrics import METRICS, Deformed, measure
from eval.metrics.shape import MeasuredShape, ShapeTopology, intersecting_faces
from sshade import DeformationTask, Handles, Mesh
from tests.shapes import bent, bumpy, jittered, strip

#: Measures that other tests of this folder compare with their definitions.
ELSEWHERE = {"zero_area_faces", "flips", "self_intersections", "hausdorff", "chamfer"}


def uneven(mesh: Mesh) -> Mesh:
    """Return a mesh whose faces are several times as large at one end as at the opposite end."""
    mesh = jittered(mesh, 0.05)
    return Mesh(mesh.V * np.exp(0.6 * mesh.V[:, :1]) * [1.0, 0.7, 1.4], mesh.F)


def task_of(mesh: Mesh) -> DeformationTask:
    """Return a task with two groups of handles, whose targets no result reaches, and with a ground truth."""
    index = np.array([3, 4, 40, 41, 42])
    handles = Handles(index, mesh.V[index] + [0.1, 0.2, -0.3], group=np.array([0, 0, 7, 7, 7]))
    truth = bent(mesh.V, 0.5) * [1.0, 1.1, 0.95]
    return DeformationTask("task", mesh, handles, truth=truth)


def deformed_of(mesh: Mesh) -> np.ndarray:
    """Bend and stretch a mesh, move all vertices a little, and shrink a face to a twentieth of its height."""
    V = bent(mesh.V, 0.7) * [1.0, 1.3, 0.8] + np.random.default_rng(5).normal(0, 0.01, mesh.V.shape)
    tip, *base = mesh.F[7]
    V[tip] = 0.05 * V[tip] + 0.95 * V[base].mean(axis=0)
    return V


def surface(V, task) -> trimesh.Trimesh:
    return trimesh.Trimesh(V, task.mesh.F, process=False)


def folds(task, V):
    """Return the change of the dihedral angle at each inner edge, in degrees, and the edges."""
    rest, now = surface(task.mesh.V, task), surface(V, task)
    signed = [s.face_adjacency_angles * np.where(s.face_adjacency_convex, 1, -1) for s in (rest, now)]
    turn = np.abs(signed[1] - signed[0])
    return np.degrees(np.minimum(turn, 2 * np.pi - turn)), rest.face_adjacency_edges


def spike(task, V):
    (turns, edges), neighbours = folds(task, V), surface(V, task).vertex_neighbors
    worst = []
    for group in set(task.handles.group):
        ring = set(task.handles.index[task.handles.group == group])
        for _ in range(2):
            ring |= {far for near in ring for far in neighbours[near]}
        worst.append(np.percentile(turns[np.isin(edges, list(ring)).any(axis=1)], 99))
    return max(worst)


def stretches(task, V):
    """Return the two singular values of each face, from its edges in a basis of its plane."""
    faces = task.mesh.F
    edges = [np.stack([X[faces[:, k]] - X[faces[:, 0]] for k in (1, 2)], 2) for X in (task.mesh.V, V)]
    before, after = (np.linalg.qr(of_shape).R for of_shape in edges)
    return np.linalg.svd(after @ np.linalg.inv(before), compute_uv=False)


def dirichlet(task, V):
    s = stretches(task, V)
    return ((s**2 + s**-2.0).sum(axis=1)) / 2 - 2, surface(task.mesh.V, task).area_faces


def percentile_by_area(task, V, percent):
    D, area = dirichlet(task, V)
    return min(d for d in D if area[d >= D].sum() >= percent / 100 * area.sum())


def collapsed(task, V):
    flipped = Deformed(task, V).flipped  # test_deformation.py tests its definition
    return sum(s.min() < 0.1 or flip for s, flip in zip(stretches(task, V), flipped, strict=True))


def detail(task, V):
    """Return the measure by libigl's Laplacian and SciPy's rotation fit, vertex by vertex."""
    mesh, area_faces = task.mesh, surface(task.mesh.V, task).area_faces
    L = -igl.cotmatrix(np.array(mesh.V), np.array(mesh.F)).toarray()
    boundary = set(igl.boundary_facets(np.array(mesh.F))[0].ravel().tolist())
    total, weight = 0.0, 0.0
    for i in set(range(mesh.n)) - boundary:
        near = [j for j in np.flatnonzero(L[i]) if j != i]
        e, f = mesh.V[near] - mesh.V[i], V[near] - V[i]
        turn = Rotation.align_vectors(f, e, weights=np.abs(L[i, near]))[0]
        d, turned = L[i] @ V, turn.apply(L[i] @ mesh.V)
        share = area_faces[(i == mesh.F).any(axis=1)].sum() / 3 * np.linalg.norm(turned)
        total += share * np.arccos(d @ turned / np.linalg.norm(d) / np.linalg.norm(turned))
        weight += share
    return np.degrees(total / weight)


def truth_normal(task, V):
    true = surface(task.truth, task)
    cosine = (surface(V, task).face_normals * true.face_normals).sum(axis=1)
    return np.degrees(np.average(np.arccos(np.clip(cosine, -1, 1)), weights=true.area_faces))


def change(of, task, V, other):
    """Return the absolute change of a fact of the surface from another shape, and the fact of that shape."""
    before, after = (getattr(surface(X, task), of) for X in (other, V))
    return np.abs(after - before), np.abs(before)


def share(of, task, V, other):
    """Return the mean change over the largest value, in percent."""
    changed, before = change(of, task, V, other)
    return 100 * np.mean(changed) / np.max(before)


def places(task, V):
    return 100 * np.linalg.norm(V - task.truth, axis=1) / np.linalg.norm(np.ptp(task.mesh.V, axis=0))


def relative_angles(task, V):
    changed, before = change("face_angles", task, V, task.mesh.V)
    return 100 * (changed / before).mean()


def handle(task, V):
    gap = np.linalg.norm(V[task.handles.index] - task.handles.target, axis=1)
    return 100 * gap.mean() / task.mesh.diagonal


DEFINITIONS = {
    "volume": lambda t, V: share("volume", t, V, t.mesh.V),
    "area": lambda t, V: share("area", t, V, t.mesh.V),
    "edge": lambda t, V: share("edges_unique_length", t, V, t.mesh.V),
    "angle": lambda t, V: np.degrees(change("face_angles", t, V, t.mesh.V)[0].mean()),
    "angle_relative": relative_angles,
    "handle": handle,
    "distortion": lambda t, V: np.average(dirichlet(t, V)[0], weights=dirichlet(t, V)[1]),
    "distortion_95": lambda t, V: percentile_by_area(t, V, 95),
    "distortion_99": lambda t, V: percentile_by_area(t, V, 99),
    "distortion_max": lambda t, V: dirichlet(t, V)[0].max(),
    "collapsed": collapsed,
    "bend": lambda t, V: folds(t, V)[0].mean(),
    "bend_tail": lambda t, V: np.percentile(folds(t, V)[0], 99.9),
    "spike": spike,
    "detail": detail,
    "truth_distance": lambda t, V: places(t, V).mean(),
    "truth_distance_95": lambda t, V: np.percentile(places(t, V), 95),
    "truth_normal": truth_normal,
    "truth_volume": lambda t, V: share("volume", t, V, t.truth),
    "truth_edge": lambda t, V: share("edges_unique_length", t, V, t.truth),
    "truth_angle": lambda t, V: np.degrees(change("face_angles", t, V, t.truth)[0].mean()),
}


def test_every_measure_has_a_definition_here_or_elsewhere():
    assert DEFINITIONS.keys() | ELSEWHERE == METRICS.keys() and not DEFINITIONS.keys() & ELSEWHERE


@cache
def example(open: bool) -> tuple[DeformationTask, np.ndarray, dict[str, float | None]]:
    mesh = uneven(strip(14, 7) if open else bumpy(2))
    task, V = task_of(mesh), deformed_of(mesh)
    return task, V, measure(task, V)


@pytest.mark.parametrize("name", DEFINITIONS)
@pytest.mark.parametrize("open", [False, True], ids=["closed", "open"])
def test_against_the_definition(name, open):
    task, V, measured = example(open)
    if open and name in ("volume", "truth_volume"):
        assert measured[name] is None
    else:
        assert measured[name] == pytest.approx(DEFINITIONS[name](task, V), rel=1e-7) and measured[name] > 0


def test_a_mesh_turned_inside_out_has_the_same_measures():
    task, V, measured = example(open=False)
    turned = replace(task, mesh=Mesh(task.mesh.V, task.mesh.F[:, ::-1]))
    assert measure(turned, V) == pytest.approx(measured)


def test_faces_that_intersect_at_rest_do_not_count():
    V = [[0.0, 0, 0], [4, 0, 0], [0, 4, 0], [1, 1, -1], [1, 1, 1], [2, 1, 1]]
    V = np.array([*V, [1, 1, 8], [1, 1, 9], [1, 2, 9]])
    mesh = Mesh(V, np.arange(9).reshape(3, 3))
    assert intersecting_faces(V, mesh.F).tolist() == [True, True, False]
    points = np.vstack([np.full((3, 3), 9.0), V]), np.vstack([[[0, 1, 2]], mesh.F + 3])
    assert intersecting_faces(*points).tolist() == [False, True, True, False]
    task = DeformationTask("t", mesh, Handles(np.array([0, 3, 6]), V[[0, 3, 6]]))
    assert measure(task, V)["self_intersections"] == 0
    lowered = V - np.where(np.arange(9) >= 6, 8.5, 0.0)[:, None] * [0, 0, 1]
    assert intersecting_faces(lowered, mesh.F).all() and measure(task, lowered)["self_intersections"] == 1


@pytest.mark.parametrize("sign", [1, -1])
def test_angles_beside_an_edge_without_length_are_zero_in_every_direction(sign):
    """Products with its coordinates are zeros, whose sign a rigid motion changes."""
    V = sign * np.array([[1.0, 1, 1], [1, 1, 1], [2, 3, 4], [4, 2, 3]])
    shape = MeasuredShape(ShapeTopology(np.array([[0, 1, 2], [1, 0, 3]]), 4), V)
    assert not shape.corner_angles.any() and not shape.dihedral_angles.any()

"""Every measure agrees with its definition, by libigl or face by face, on faces that differ in size."""

from functools import cache
from itertools import combinations

import igl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eval.metrics import METRICS, Deformed, measure
from eval.metrics.intersections import intersecting_faces
from sshade.mesh.mesh import Mesh
from sshade.problem.task import DeformationTask, Handles
from tests.shapes import bent, bumpy, jittered, rotation, strip

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


def normal(V, face):
    a, b, c = V[face]
    n = np.cross(b - a, c - a)
    return n / np.linalg.norm(n)


def areas(V, F):
    return igl.doublearea(np.array(V), np.array(F)) / 2


def corner_angles(V, F):
    return igl.internal_angles(np.array(V), np.array(F)).ravel()


def edges_of(F):
    return sorted({tuple(sorted(map(int, pair))) for face in F for pair in combinations(face, 2)})


def lengths(V, F):
    return np.array([np.linalg.norm(V[i] - V[j]) for i, j in edges_of(F)])


def enclosed(V, F):
    """Return the enclosed volume, as a sum of tetrahedra between the faces and an arbitrary point."""
    return sum(np.linalg.det(V[face] - [0.3, -0.2, 0.1]) for face in F) / 6


def dihedral(V, F):
    """Return the angle between the normals of the two faces at each inner edge.

    The angle is positive if the second face lies behind the first face, that is, at convex edges.
    """
    at = {}
    for face in F:
        for i, j in combinations(face, 2):
            at.setdefault((min(i, j), max(i, j)), []).append(face)
    found = {}
    for edge, faces in at.items():
        if len(faces) == 2:
            one, two = faces
            n = normal(V, one)
            apex = next(v for v in two if v not in edge)
            angle = np.arccos(np.clip(n @ normal(V, two), -1, 1))
            found[edge] = angle if n @ (V[apex] - V[edge[0]]) < 0 else -angle
    return found


def folds(task, V):
    rest, now = dihedral(task.mesh.V, task.mesh.F), dihedral(V, task.mesh.F)
    turns = {edge: abs(now[edge] - rest[edge]) for edge in rest}
    return {edge: np.degrees(min(turn, 2 * np.pi - turn)) for edge, turn in turns.items()}


def spike(task, V):
    handles, neighbours = task.handles, {}
    for i, j in edges_of(task.mesh.F):
        neighbours.setdefault(i, set()).add(j)
        neighbours.setdefault(j, set()).add(i)
    worst = []
    for group in set(handles.group):
        ring = {int(v) for v in handles.index[handles.group == group]}
        for _ in range(2):
            ring |= {far for near in ring for far in neighbours[near]}
        worst.append(np.percentile([x for edge, x in folds(task, V).items() if ring & set(edge)], 99))
    return max(worst)


def stretches(task, V):
    """Return the two singular values of the deformation of each face.

    The linear map of a face also maps its unit normal at rest to its deformed unit normal. The singular
    value of the normal, which is 1, is left out.
    """
    found = []
    for face in task.mesh.F:
        before, after = (
            np.column_stack([X[face[1]] - X[face[0]], X[face[2]] - X[face[0]], normal(X, face)])
            for X in (task.mesh.V, V)
        )
        A = after @ np.linalg.inv(before)
        G = A.T @ A - np.outer(normal(task.mesh.V, face), normal(task.mesh.V, face))
        found.append(np.sqrt(np.linalg.eigvalsh(G)[1:]))
    return np.array(found)


def dirichlet(task, V):
    s = stretches(task, V)
    return ((s**2 + s**-2.0).sum(axis=1)) / 2 - 2, areas(task.mesh.V, task.mesh.F)


def percentile_by_area(task, V, percent):
    D, area = dirichlet(task, V)
    return min(d for d in D if area[d >= D].sum() >= percent / 100 * area.sum())


def collapsed(task, V):
    flipped = Deformed(task, V).flipped  # test_deformation.py tests its definition
    return sum(s.min() < 0.1 or flip for s, flip in zip(stretches(task, V), flipped, strict=True))


def detail(task, V):
    """Return the measure by libigl's Laplacian and SciPy's rotation fit, vertex by vertex."""
    mesh = task.mesh
    L = -igl.cotmatrix(np.array(mesh.V), np.array(mesh.F)).toarray()
    boundary = set(igl.boundary_facets(np.array(mesh.F))[0].ravel().tolist())
    total, weight = 0.0, 0.0
    for i in set(range(mesh.n)) - boundary:
        near = [j for j in np.flatnonzero(L[i]) if j != i]
        e, f = mesh.V[near] - mesh.V[i], V[near] - V[i]
        turn = Rotation.align_vectors(f, e, weights=np.abs(L[i, near]))[0]
        d, turned = L[i] @ V, turn.apply(L[i] @ mesh.V)
        share = areas(mesh.V, mesh.F)[(i == mesh.F).any(axis=1)].sum() / 3 * np.linalg.norm(turned)
        total += share * np.arccos(d @ turned / np.linalg.norm(d) / np.linalg.norm(turned))
        weight += share
    return np.degrees(total / weight)


def truth_normal(task, V):
    angle = [np.arccos(np.clip(normal(V, f) @ normal(task.truth, f), -1, 1)) for f in task.mesh.F]
    return np.degrees(np.average(angle, weights=areas(task.truth, task.mesh.F)))


def change(of, before, after, F):
    return abs(of(after, F) - of(before, F))


def area(V, F):
    return areas(V, F).sum()


def places(task, V):
    return 100 * np.linalg.norm(V - task.truth, axis=1) / np.linalg.norm(np.ptp(task.mesh.V, axis=0))


DEFINITIONS = {
    "volume": lambda t, V: 100 * change(enclosed, t.mesh.V, V, t.mesh.F) / enclosed(t.mesh.V, t.mesh.F),
    "area": lambda t, V: 100 * change(area, t.mesh.V, V, t.mesh.F) / area(t.mesh.V, t.mesh.F),
    "edge": lambda t, V: (
        100 * change(lengths, t.mesh.V, V, t.mesh.F).mean() / lengths(t.mesh.V, t.mesh.F).max()
    ),
    "angle": lambda t, V: np.degrees(change(corner_angles, t.mesh.V, V, t.mesh.F).mean()),
    "angle_relative": lambda t, V: (
        100 * (change(corner_angles, t.mesh.V, V, t.mesh.F) / corner_angles(t.mesh.V, t.mesh.F)).mean()
    ),
    "handle": lambda t, V: (
        100 * np.linalg.norm(V[t.handles.index] - t.handles.target, axis=1).mean() / t.mesh.diagonal
    ),
    "distortion": lambda t, V: np.average(dirichlet(t, V)[0], weights=dirichlet(t, V)[1]),
    "distortion_95": lambda t, V: percentile_by_area(t, V, 95),
    "distortion_99": lambda t, V: percentile_by_area(t, V, 99),
    "distortion_max": lambda t, V: dirichlet(t, V)[0].max(),
    "collapsed": collapsed,
    "bend": lambda t, V: np.mean(list(folds(t, V).values())),
    "bend_tail": lambda t, V: np.percentile(list(folds(t, V).values()), 99.9),
    "spike": spike,
    "detail": detail,
    "truth_distance": lambda t, V: places(t, V).mean(),
    "truth_distance_95": lambda t, V: np.percentile(places(t, V), 95),
    "truth_normal": truth_normal,
    "truth_volume": lambda t, V: (
        100 * change(enclosed, t.truth, V, t.mesh.F) / abs(enclosed(t.truth, t.mesh.F))
    ),
    "truth_edge": lambda t, V: (
        100 * change(lengths, t.truth, V, t.mesh.F).mean() / lengths(t.truth, t.mesh.F).max()
    ),
    "truth_angle": lambda t, V: np.degrees(change(corner_angles, t.truth, V, t.mesh.F).mean()),
}


def test_every_measure_has_a_definition_here_or_elsewhere():
    assert DEFINITIONS.keys() | ELSEWHERE == METRICS.keys() and not DEFINITIONS.keys() & ELSEWHERE


@cache
def example(open: bool) -> tuple[DeformationTask, np.ndarray]:
    mesh = uneven(strip(14, 7) if open else bumpy(2))
    return task_of(mesh), deformed_of(mesh)


@cache
def measured(open: bool) -> dict[str, float | None]:
    return measure(*example(open))


@pytest.mark.parametrize("name", DEFINITIONS)
@pytest.mark.parametrize("open", [False, True], ids=["closed", "open"])
def test_against_the_definition(name, open):
    task, V = example(open)
    found = measured(open)[name]
    if open and name in ("volume", "truth_volume"):
        assert found is None
    else:
        assert found == pytest.approx(DEFINITIONS[name](task, V), rel=1e-7) and found > 0


def test_invariant_under_the_order_of_vertices_faces_corners_and_handles():
    task, rng = task_of(uneven(bumpy(2))), np.random.default_rng(1)
    mesh, handles, V = task.mesh, task.handles, deformed_of(task.mesh)
    old = rng.permutation(mesh.n)
    new = np.argsort(old)
    first = rng.integers(0, 3, mesh.m)[:, None]
    F = new[np.take_along_axis(mesh.F, (first + np.arange(3)) % 3, axis=1)][rng.permutation(mesh.m)]
    at = rng.permutation(len(handles))
    other = DeformationTask(
        "other",
        Mesh(mesh.V[old], F),
        Handles(new[handles.index[at]], handles.target[at], group=handles.group[at]),
        truth=task.truth[old],
    )
    assert measure(other, V[old]) == pytest.approx(measure(task, V), rel=1e-9)


def test_a_rigid_motion_of_the_result_changes_no_measure_but_places_and_normals():
    """The motion is large: a shape of about a metre moves by about a kilometre."""
    task = task_of(uneven(bumpy(2)))
    V = deformed_of(task.mesh)
    here, there = (measure(task, X) for X in (V, V @ rotation(2).T + [800.0, -500.0, 300.0]))
    of_place = {"handle", "truth_distance", "truth_distance_95", "truth_normal"}
    assert here.keys() >= of_place
    assert {name for name in here if there[name] != pytest.approx(here[name], rel=1e-7)} == of_place


def test_faces_that_intersect_at_rest_do_not_count():
    V = np.array(
        [[0.0, 0, 0], [4, 0, 0], [0, 4, 0], [1, 1, -1], [1, 1, 1], [2, 1, 1], [1, 1, 8], [1, 1, 9], [1, 2, 9]]
    )
    mesh = Mesh(V, np.arange(9).reshape(3, 3))
    assert intersecting_faces(V, mesh.F).tolist() == [True, True, False]
    task = DeformationTask("t", mesh, Handles(np.array([0, 3, 6]), V[[0, 3, 6]]))
    assert measure(task, V)["self_intersections"] == 0
    lowered = V - np.where(np.arange(9) >= 6, 8.5, 0.0)[:, None] * [0, 0, 1]
    assert intersecting_faces(lowered, mesh.F).all() and measure(task, lowered)["self_intersections"] == 1

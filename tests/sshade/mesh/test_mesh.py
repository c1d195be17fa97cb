"""Meshes: areas, normals, rigid motions, gaps between components, and components without handles."""

from functools import cached_property
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import spatial
from scipy.spatial.transform import Rotation

from sshade import DeformationTask, Handles, Mesh, deform
from sshade.mesh.mesh import unit_rows
from sshade.mesh.normals import turned, vertex_turns
from sshade.mesh.quality import NEAR, NearParts, surface_points
from sshade.mesh.rigid import common_motion, rigid_motion
from sshade.mesh.unconstrained import leaders
from tests.shapes import beside, block, bumpy, icosphere, rotation, shifted, tetrahedron, tube

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


def test_areas_normals_volume_and_diagonal_of_a_block_are_exact():
    mesh = block(np.ones((2, 3, 4)))
    assert mesh.area == pytest.approx(2 * (6 + 8 + 12), rel=1e-14)
    assert mesh.volume == pytest.approx(24, rel=1e-14)
    assert mesh.diagonal == pytest.approx(np.sqrt(4 + 9 + 16), rel=1e-15)
    assert np.allclose(np.abs(mesh.face_normals).sum(axis=1), 1.0)
    # Coordinates are exact to 1e-10; moments about the origin would lose 1e17 x 1e-16.
    assert Mesh(mesh.V + 1e6 / 3, mesh.F[:, ::-1]).volume == pytest.approx(-24, rel=1e-8)
    flat = Mesh(np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], np.float32), [[0, 1, 2], [0, 1, 3]])
    assert flat.V.dtype == np.float64 and flat.F.dtype == np.int64
    assert flat.face_areas.tolist() == [0.0, 0.5] and flat.face_normals.tolist() == [[0, 0, 0], [0, 0, 1]]
    a, b, c = mesh.V[mesh.F].transpose(1, 0, 2)
    assert np.allclose(mesh.face_areas[:, None] * mesh.face_normals, np.cross(b - a, c - a) / 2)


@pytest.mark.parametrize("shift", [2.0**20, -(2.0**35), 1e9 + 0.5])
@pytest.mark.parametrize("factor", [1.0, 0.37])
def test_coordinates_relative_to_the_origin_of_a_far_mesh_are_exact(shift, factor):
    mesh = tetrahedron()
    far = Mesh(factor * mesh.V + [shift, 0, -shift], mesh.F)
    relative = far.V - far.origin
    assert np.abs(relative).max() <= 8 * np.ptp(far.V, axis=0).max()
    assert far.origin[1] == 0 and np.array_equal(relative + far.origin, far.V)
    assert np.array_equal(np.diff(relative, axis=0), np.diff(far.V, axis=0))


#: Without triangles of equal area: the largest triangle at a vertex is the same in any order.
ROUND = icosphere(3)
BALL = Mesh(unit_rows(ROUND.V + np.random.default_rng(0).uniform(-0.03, 0.03, (642, 3))), ROUND.F)
POSED = BALL.V * [1.0, 1.5, 0.75] + 0.2 * BALL.V[:, [1, 2, 0]] ** 2
TURNED = vertex_turns(BALL.V, BALL.F, BALL.V, POSED)


def random_side(F):
    return np.where(np.random.default_rng(0).random((len(F), 1)) < 0.5, F, F[:, ::-1])


@pytest.mark.parametrize(
    "faces",
    [lambda F: F[:, ::-1], random_side, lambda F: np.concatenate([F, F[:, ::-1]])],
    ids=["turned around", "of random sides", "with both sides"],
)
def test_normals_do_not_depend_on_the_sides_of_triangles(faces):
    F = np.ascontiguousarray(faces(BALL.F))
    found = turned(vertex_turns(BALL.V, F, BALL.V, POSED), BALL.V)
    np.testing.assert_allclose(found, turned(TURNED, BALL.V), rtol=0, atol=1e-12)


def test_a_seam_with_rounded_normals_stays_smooth():
    """Each triangle has corners of its own, and their normals are rounded to three decimals."""
    F = np.arange(BALL.F.size).reshape(-1, 3)
    noise = np.random.default_rng(0).uniform(-0.4, 0.4, (F.size, 3)) * 1e-3
    N = np.round(BALL.V[BALL.F.ravel()] + noise, 3)
    rest = BALL.V[BALL.F.ravel()] + 1e-9 * noise
    rest.setflags(write=False)
    Q = vertex_turns(N, F, rest, POSED[BALL.F.ravel()])
    np.testing.assert_allclose(Q, TURNED[BALL.F.ravel()], rtol=0, atol=2e-6)


TUBE = tube(16, 10, length=2.0)


def chain(step: float, count: int = 5) -> Mesh:
    return beside(*(shifted(TUBE, [0, 0, step * k]) for k in range(count)))


@pytest.mark.parametrize("step", [1.7, 2.0, 2.02])
def test_tubes_that_overlap_or_nearly_touch_open_by_the_distance_of_their_surfaces(step):
    mesh = chain(step)
    parts = NearParts(mesh)
    moved = mesh.V.copy()
    moved[3 * TUBE.n :] += [0, 0, 3 - step]  # the ends are 1 apart
    gap = parts.gap(moved)
    assert gap is not None and gap.components == (2, 3) and gap.pairs == 1
    assert 0.95 <= gap.distance * mesh.diagonal <= max(3 - step, 1.05)


def test_shapes_that_stay_together_have_no_gap():
    """They move rigidly, grow, slide along each other, or were apart at rest."""
    mesh = chain(1.7)
    slid = mesh.V.copy()
    slid[TUBE.n : 2 * TUBE.n] += [0, 0, 0.1]
    for V in (mesh.V, mesh.V @ rotation(1).T + 3, 10 * mesh.V, slid):
        assert NearParts(mesh).gap(V) is None
    apart = chain(2 + 2 * NEAR * mesh.diagonal)
    assert NearParts(apart).gap(apart.V * [1, 1, 3]) is None


def test_boxes_of_long_triangles_that_pierce_each_other_are_near():
    """No vertex is near the other box."""
    one = shifted(block(np.ones((1, 1, 1))), -1.0)
    mesh = beside(one, Mesh((one.V - 0.5) * [0.2, 0.2, 5] + 0.5, one.F))
    moved = np.where(np.arange(mesh.n)[:, None] < one.n, mesh.V, mesh.V + [2.0, 0, 0])
    gap = NearParts(mesh).gap(moved)
    assert gap is not None and gap.distance * mesh.diagonal == pytest.approx(1.4, abs=0.2)
    corners, weights = surface_points(one, 0.1)
    P = np.einsum("pk,pkc->pc", weights, one.V[corners])
    np.testing.assert_allclose(np.abs(P - 0.5).max(axis=1), 0.5)
    assert len(P) > 600


def proper(R: np.ndarray) -> bool:
    return np.allclose(R @ R.T, np.eye(3), atol=1e-13) and np.linalg.det(R) > 0


@given(seed=st.integers(0, 10_000), count=st.integers(3, 8))
def test_kabsch_equals_scipys_alignment(seed, count):
    rng = np.random.default_rng(seed)
    source, target = rng.normal(size=(2, count, 3))
    target = target if seed % 2 else source @ rotation(seed).T + target[0]  # a rigid motion for even seeds
    R, t = rigid_motion(source, target)
    assert proper(R)
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    reference = Rotation.align_vectors(b, a)[0].as_matrix()
    gap, best = np.linalg.norm(source @ R.T + t - target), np.linalg.norm(a @ reference.T - b)
    assert gap <= best * (1 + 1e-12) + 1e-12
    assert np.allclose(R, reference, atol=1e-6)


def test_kabsch_of_points_on_a_line_is_the_smallest_rotation():
    line = np.linspace(-1, 1, 5)[:, None]
    for a, b in ([[1, 0, 0], [0, 1, 0]], [[0, 0, 1], [0.6, 0, 0.8]]):
        a, b = np.array(a, dtype=float), np.array(b, dtype=float)
        R, t = rigid_motion(line * a + 2, line * b - 1)
        assert proper(R) and np.allclose(R @ a, b, atol=1e-13)
        assert Rotation.from_matrix(R).magnitude() == pytest.approx(np.arccos(a @ b))
        assert np.allclose((line * a + 2) @ R.T + t, line * b - 1, atol=1e-13)
    R, t = rigid_motion(np.ones((4, 3)), np.arange(12.0).reshape(4, 3))  # one place
    assert np.array_equal(R, np.eye(3)) and np.allclose(t, np.arange(12.0).reshape(4, 3).mean(axis=0) - 1)
    turned, _ = rigid_motion(line * [0.0, 0.6, 0.8], -line * [0.0, 0.6, 0.8])
    assert proper(turned) and np.allclose(turned @ [0, 0.6, 0.8], [0, -0.6, -0.8], atol=1e-13)


#: Units of length.
UNITS = [1e-9, 1.0, 1e9]


@pytest.mark.parametrize("unit", UNITS)
def test_points_with_a_common_motion(unit):
    P, R, t = unit * icosphere(1).V, rotation(2), unit * np.array([3.0, -1, 20])
    for Q in (P + t, P @ R.T + t, P.astype(np.float32) @ R.T.astype(np.float32) + t):
        found, shift = common_motion(P, Q)
        assert np.abs(P @ found.T + shift - Q).max() < 1e-6 * unit
    found, shift = common_motion(P[:1], P[:1] + t)
    assert np.array_equal(found, np.eye(3)) and np.allclose(shift, t, atol=0)
    line = unit * np.outer(np.arange(5.0), [1, 2, 3])
    assert np.array_equal(common_motion(line, line + t)[0], np.eye(3))


@pytest.mark.parametrize("unit", UNITS)
def test_points_without_one_or_with_several(unit):
    P, R = unit * icosphere(1).V, rotation(2)
    bent, mirrored, line = P.copy(), P * [1, 1, -1], unit * np.outer(np.arange(5.0), [1, 2, 3])
    bent[0] *= 1 + 1e-5
    narrow = P * [1, 0.01, 0.01]
    for source, target in ((P, bent), (P, mirrored), (line, line @ R.T), (narrow, narrow @ R.T)):
        assert common_motion(source, target) is None


BODY = bumpy(2)


def in_order(mesh: Mesh) -> Mesh:
    """Return the mesh with its vertices numbered along x."""
    order = np.argsort(mesh.V[:, 0])
    return Mesh(mesh.V[order], np.argsort(order)[mesh.F])


#: Places of bodies in a row, in widths, and whether each moves. Of the first and the last all vertices are
#: handles: the first is fixed, the last is lifted. Bodies follow their neighbours, also through others.
ROWS = {((0, 1.0 + gap, 2.0 + 2 * gap, 3.4 + 3 * gap), (0, 0, 0, 1)) for gap in (0.0, 0.05, -0.2)}
ROWS |= {((0, 1.2, 2.8), (0, 0, 1)), ((0, 1.6, 2.8), (0, 1, 1))}


@pytest.mark.parametrize(("places", "moves"), sorted(ROWS))
def test_a_component_follows_the_one_that_it_is_next_to(places, moves):
    """In a row of four, the third touches the second, but its nearest handle is of the fourth."""
    body, n = in_order(bumpy(4)), bumpy(4).n
    mesh = beside(*(shifted(body, [x * np.ptp(body.V[:, 0]), 0, 0]) for x in places))
    index = np.append(np.arange(n), np.arange(mesh.n - n, mesh.n))
    target = mesh.V[index] + np.repeat([[0, 0, 0], [0, 2.0, 0]], n, axis=0)
    shape = deform(DeformationTask("row", mesh, Handles(index, target))).vertices
    np.testing.assert_allclose((shape - mesh.V)[:, 1], np.repeat(np.multiply(2.0, moves), n), atol=1e-12)
    np.testing.assert_allclose((shape - mesh.V)[:, ::2], 0, atol=1e-12)


def test_beads_follow_the_surface_and_not_each_other(monkeypatch):
    trees = Mock(wraps=spatial.cKDTree)
    monkeypatch.setattr(spatial, "cKDTree", trees)
    order = np.argsort(BODY.V[:, 2])[::10]
    beads = [shifted(Mesh(0.04 * BODY.V, BODY.F), place) for place in 1.02 * BODY.V[order]]
    mesh = beside(BODY, *beads)
    led = leaders(mesh, np.arange(1, len(beads) + 1))
    assert sorted(mesh.component[moved[0]] for moved, _ in led) == list(range(1, len(beads) + 1))
    assert {mesh.component[near[0]] for _, near in led} == {0}
    assert trees.call_count <= 3  # not one for each bead


def test_arrays_of_a_mesh_are_computed_once():
    """Also those that are new."""
    names = [name for name in dir(Mesh) if isinstance(vars(Mesh).get(name), (property, cached_property))]
    mesh, arrays = bumpy(1), 0
    for name in names:
        value = getattr(mesh, name)
        if isinstance(value, np.ndarray):
            arrays += 1
            assert value is getattr(mesh, name), name
    assert arrays > 5

"""Seams: vertices that are merged, and vertices at one position that stay apart."""

import numpy as np
import pytest

from sshade import Mesh
from sshade.mesh.places import same_places, same_rows
from sshade.mesh.surface import surface
from tests.refusals import refusals
from tests.shapes import beside, icosphere, jittered, quads, shifted, strip, unjoined
from tests.sshade.mesh.test_cutting import moebius

SPHERE = icosphere(2)


def split(mesh: Mesh, first: np.ndarray) -> Mesh:
    """Return the mesh cut along the border of the faces `first` (m,) bool, with separate vertices."""
    F = np.where(first[:, None], mesh.F, mesh.F + mesh.n)
    used, F = np.unique(F, return_inverse=True)
    return Mesh(np.concatenate([mesh.V, mesh.V])[used], F.reshape(-1, 3))


HALF = SPHERE.V[SPHERE.F].mean(axis=1)[:, 0] > 0


@pytest.mark.parametrize(
    "parts",
    [unjoined(SPHERE), split(SPHERE, HALF), split(SPHERE, np.random.default_rng(1).random(SPHERE.m) < 0.3)],
)
def test_a_surface_cut_anywhere_becomes_whole_again(parts):
    joined, vertex, facts = surface(parts.V, parts.F)
    assert parts.n > SPHERE.n == joined.n and joined.m == SPHERE.m
    assert facts.near == 0
    assert np.array_equal(joined.V[vertex], parts.V) and np.array_equal(joined.F, vertex[parts.F])
    assert joined.topology == SPHERE.topology


def test_without_a_seam_arrays_are_not_even_copied():
    square = strip(2, 2)
    point = beside(square, Mesh(-square.V, square.F))  # two parts that touch in a point
    twice = beside(SPHERE, SPHERE)
    parallel = beside(square, square)  # the same orientation twice
    for mesh in (SPHERE, point, twice, parallel):
        joined, vertex, _ = surface(mesh.V, mesh.F)
        assert joined.V is mesh.V and joined.F is mesh.F and np.array_equal(vertex, np.arange(mesh.n))


def test_a_pole_of_many_vertices_with_faces_without_area_closes():
    """Exporters make a globe of rows of squares; each pole is a row of many vertices at one place."""
    k = 8
    angle = 2 * np.pi * (np.arange(k + 1) % k) / k
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(k + 1)])
    V = np.concatenate([ring, np.tile([0.0, 0, 1], (k + 1, 1)), ring, np.tile([0.0, 0, -1], (k + 1, 1))])
    up = quads(2, k + 1)
    F = np.concatenate([up, up[:, ::-1] + 2 * (k + 1)])
    joined, vertex, _ = surface(V, F)
    assert joined.n == k + 2 and joined.is_closed and joined.topology.euler == 2
    assert np.array_equal(joined.V[vertex], V)


def test_near_places_are_one_but_neither_chains_nor_crowds():
    tolerance = np.full(3, 0.1)
    assert same_places(np.array([[0.0, 0, 0], [0.05, 0, 0], [1, 0, 0]]), tolerance).tolist() == [0, 0, 2]
    for points in (
        0.15 * np.eye(3)[:1] * np.arange(100)[:, None],
        np.random.default_rng(0).random((3000, 3)) / 20,
    ):
        assert len(np.unique(same_places(points, tolerance))) == len(points)


def test_equal_rows_have_equal_ids():
    rng = np.random.default_rng(0)
    rows = rng.integers(-1, 2, (300, 4)) * -0.0 + rng.integers(0, 3, (300, 4))
    ids = same_rows(rows)
    assert np.array_equal(ids[:, None] == ids, (rows[:, None] == rows).all(axis=2))
    assert set(ids) == set(range(ids.max() + 1))


@pytest.mark.parametrize("mesh", [SPHERE, moebius(20)])
def test_a_soup_whose_triangles_disagree_about_their_direction_becomes_whole(mesh):
    parts, turned = unjoined(mesh), np.random.default_rng(0).random(mesh.m) < 0.3
    joined, vertex, _ = surface(parts.V, np.where(turned[:, None], parts.F[:, ::-1], parts.F))
    assert joined.n == mesh.n and joined.topology == mesh.topology
    assert np.array_equal(joined.V[vertex], parts.V)


def test_sheets_upon_each_other_stay_two_unless_repaired():
    sheet = jittered(strip(9, 7), 0.2)
    other = Mesh(sheet.V, sheet.F[:, [1, 2, 0]])
    for noise in (0.0, 1e-10, 1e-6):
        two = beside(sheet, shifted(other, noise * sheet.diagonal))
        assert surface(two.V, two.F).mesh.n == two.n
        assert (surface(two.V, two.F, repair=True).mesh.n == sheet.n) == (noise < 1e-9)


def test_a_rim_that_is_finer_than_the_tolerance_is_no_seam():
    """The mesh is far from the origin: neighbours are only three steps of single precision apart."""
    land = strip(30, 20)
    V = (0.1 * land.V + [5e5, 4e5, 0]).astype(np.float32)
    assert surface(V, land.F).mesh.n == land.n


def test_merging_takes_no_vertex_its_last_face():
    """A face has two corners at one place. If they were merged, its third corner would have no face."""
    V = np.array([[0.0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 2, 0], [1, 2, 0]])
    joined, vertex, _ = surface(V, np.array([[0, 1, 2], [3, 4, 5]]))
    assert joined.n == 6 and (vertex >= 0).all()


def test_the_tolerance_decides_which_gaps_close():
    parts = split(SPHERE, HALF)
    V = np.array(parts.V)
    V[parts.n // 2 :] += 1e-7
    assert not surface(V, parts.F).mesh.is_closed
    whole = surface(V, parts.F, weld=1e-6)
    assert whole.mesh.topology == SPHERE.topology and whole.facts.near > 0
    assert not surface(parts.V + np.where(parts.V == V, 0, 1e-14), parts.F, weld=0).mesh.is_closed


SLIVERS = strip(30, 1)
REFUSED = {
    "weld is a fraction of the diagonal": lambda: surface(SPHERE.V, SPHERE.F, weld=0.1),
    "all 3 faces are points": lambda: surface(np.zeros((9, 3)), np.arange(9).reshape(3, 3)),
    "all 60 faces have two corners at one": lambda: surface(SLIVERS.V * [1, 0, 1], SLIVERS.F, repair=True),
}


test_what_leaves_no_surface_is_refused = refusals(REFUSED)


def test_slivers_are_a_surface():
    assert surface(SLIVERS.V * [1, 1e-9, 1], SLIVERS.F, repair=True).mesh.n == SLIVERS.n

"""Seams: vertices that are merged, and vertices at one position that stay apart."""

import numpy as np
import pytest

from sshade import Mesh
from sshade.mesh.seams import same_rows
from sshade.mesh.surface import surface
from tests.shapes import beside, icosphere

SPHERE = icosphere(2)


def split(mesh: Mesh, first: np.ndarray) -> Mesh:
    """The mesh with vertices of its own for the faces `first` (m,) bool."""
    F = np.where(first[:, None], mesh.F, mesh.F + mesh.n)
    used, F = np.unique(F, return_inverse=True)
    return Mesh(np.concatenate([mesh.V, mesh.V])[used], F.reshape(-1, 3))


SOUP = Mesh(SPHERE.V[SPHERE.F].reshape(-1, 3), np.arange(3 * SPHERE.m).reshape(-1, 3))
HALF = SPHERE.V[SPHERE.F].mean(axis=1)[:, 0] > 0


@pytest.mark.parametrize(
    "parts", [SOUP, split(SPHERE, HALF), split(SPHERE, np.random.default_rng(1).random(SPHERE.m) < 0.3)]
)
def test_a_surface_cut_anywhere_becomes_whole_again(parts):
    joined, vertex, _ = surface(parts.V, parts.F)
    assert parts.n > SPHERE.n == joined.n and joined.m == SPHERE.m
    assert np.array_equal(joined.V[vertex], parts.V) and np.array_equal(joined.F, vertex[parts.F])
    assert joined.topology == SPHERE.topology


def test_without_a_seam_arrays_are_not_even_copied():
    strip = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0], [-1, 0, 0], [0, -1, 0]], [[0, 1, 2], [3, 4, 5]])
    twice = beside(SPHERE, SPHERE)
    parallel = Mesh(np.concatenate([strip.V[:3]] * 2), [[0, 1, 2], [3, 4, 5]])  # both run the same way
    for mesh in (SPHERE, strip, twice, parallel):
        joined, vertex, _ = surface(mesh.V, mesh.F)
        assert joined.V is mesh.V and joined.F is mesh.F and np.array_equal(vertex, np.arange(mesh.n))


def test_vertices_at_one_place_apart_from_a_seam_stay_apart():
    parts = split(SPHERE, HALF)
    inner = Mesh(
        np.concatenate([parts.V, [SPHERE.V[0]], SPHERE.V[0] + np.eye(3)[:2]]),
        np.concatenate([parts.F, [parts.n + np.arange(3)]]),
    )
    joined, vertex, _ = surface(inner.V, inner.F)
    assert joined.n == SPHERE.n + 3 and (vertex == vertex[parts.n]).sum() == 1


def test_a_pole_of_many_vertices_with_faces_without_area_closes():
    """Rows of squares up to a pole, each square with vertices of its own, as exporters make a globe."""
    k = 8
    angle = 2 * np.pi * np.arange(k + 1) / k
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(k + 1)])
    ring[-1] = ring[0]
    V = np.concatenate([ring, np.tile([0.0, 0, 1], (k + 1, 1)), ring, np.tile([0.0, 0, -1], (k + 1, 1))])
    i = np.arange(k)
    lower, upper = np.column_stack([i, i + 1, i + k + 1]), np.column_stack([i + 1, i + k + 2, i + k + 1])
    up = np.concatenate([lower, upper])
    F = np.concatenate([up, up[:, ::-1] + 2 * (k + 1)])
    joined, vertex, _ = surface(V, F)
    assert joined.n == k + 2 and joined.is_closed and joined.topology.euler == 2
    assert np.array_equal(joined.V[vertex], V)


def test_equal_rows_have_equal_ids():
    rng = np.random.default_rng(0)
    rows = rng.integers(-1, 2, (300, 4)) * -0.0 + rng.integers(0, 3, (300, 4))
    ids = same_rows(rows)
    assert np.array_equal(ids[:, None] == ids, (rows[:, None] == rows).all(axis=2))
    assert set(ids) == set(range(ids.max() + 1))

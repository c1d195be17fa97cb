from __future__ import annotations

import numpy as np
import pytest

from sshade.contact.flips import new_flips, opposes_neighbours
from sshade.mesh.mesh import Mesh
from tests.shapes import bent, bumpy


def crumpled(mesh: Mesh, at: np.ndarray, seed: int = 0) -> np.ndarray:
    """The mesh bent, with vertices thrown about."""
    V = bent(mesh.V)
    V[at] += np.random.default_rng(seed).normal(scale=0.2 * mesh.diagonal, size=(len(at), 3))
    return V


@pytest.mark.parametrize("seed", range(3))
def test_near_what_moved_the_answer_is_that_for_all(seed):
    mesh = bumpy(3)
    at = np.random.default_rng(seed).choice(mesh.n, 12, replace=False)
    before, after = bent(mesh.V), crumpled(mesh, at, seed)
    moved = np.isin(mesh.F, at).any(axis=1)
    everywhere = new_flips(mesh, after)
    assert everywhere.sum() > 5 and not new_flips(mesh, before).any()
    assert np.array_equal(new_flips(mesh, after, among=moved), everywhere)
    assert not new_flips(mesh, after, among=np.zeros(mesh.m, dtype=bool)).any()


def test_faces_far_from_those_asked_for_are_left_out():
    mesh = bumpy(3)
    V = crumpled(mesh, np.arange(0, mesh.n, 7))
    among = np.zeros(mesh.m, dtype=bool)
    among[:40] = True
    edges = np.isin(mesh.face_edges, mesh.face_edges[:40]).any(axis=1)
    assert np.array_equal(new_flips(mesh, V, among=among), new_flips(mesh, V) & edges)


def test_what_opposes_its_neighbours_at_rest_is_not_new():
    mesh = bumpy(2)
    folded = Mesh(crumpled(mesh, np.array([3, 50])), mesh.F)
    assert opposes_neighbours(folded).any() and not new_flips(folded, folded.V).any()

"""Closed meshes that hold vertices several times, with rounding noise, stay closed."""

import numpy as np
import pytest

from sshade import Mesh, deform
from tests.shapes import beside, block, bumpy, double_torus, icosphere, shifted, torus

SHAPES = {
    "sphere": bumpy(2),
    "torus": torus(16, 8),
    "cube": block(np.ones((1, 1, 1), dtype=bool), cells=4),
    "two": beside(icosphere(2), shifted(icosphere(1), [0.2, 4.0, 0.5])),
    "genus 2": double_torus(cells=1),
    "far": shifted(bumpy(2), [40.0, -3.0, 1.0]),
    "tiny": Mesh(1e-5 * torus(12, 6).V, torus(12, 6).F),
}


def split(V: np.ndarray, F: np.ndarray, share: float, rng) -> tuple[np.ndarray, np.ndarray]:
    """Give some corners a copy of their vertex."""
    chosen = rng.random(F.shape) < share
    G = F.copy()
    G[chosen] = len(V) + np.arange(chosen.sum())
    W = np.concatenate([V, V[F[chosen]]])
    used = np.unique(G)
    return W[used], np.searchsorted(used, G)


def shuffled(V: np.ndarray, F: np.ndarray, rng) -> tuple[np.ndarray, np.ndarray]:
    """Change the order of vertices and faces, and the first corners of faces."""
    order = rng.permutation(len(V))
    F = np.argsort(order)[F[rng.permutation(len(F))]]
    turn = (np.arange(3) + rng.integers(3, size=(len(F), 1))) % 3
    return V[order], np.take_along_axis(F, turn, axis=1)


def noisy(mesh: Mesh, *, whole: bool, single: bool, rng) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices, faces, and the vertex of `mesh` for each vertex: split, with noise, shuffled, turned."""
    numbered = np.column_stack([mesh.V, np.arange(mesh.n)])
    share = 1.0 if whole else rng.choice([0.1, 0.5, 0.9])
    V, F = shuffled(*split(numbered, mesh.F, share, rng), rng)
    V, origin = V[:, :3], V[:, 3].astype(np.int64)
    if single:
        steps = np.spacing(np.abs(V).max(axis=0).astype(np.float32))
        V = V.astype(np.float32) + steps * rng.integers(-2, 3, V.shape).astype(np.float32)
    else:
        V = V + rng.uniform(-1e-9, 1e-9, V.shape) * mesh.diagonal
    turned = rng.random(mesh.m) < rng.choice([0.0, 0.3])
    return V.astype(np.float64), np.where(turned[:, None], F[:, ::-1], F), origin


@pytest.mark.parametrize("single", [True, False])
@pytest.mark.parametrize("shape", SHAPES)
def test_split_and_noisy_vertices_stay_together(shape, single):
    mesh = SHAPES[shape]
    V, F, origin = noisy(mesh, whole=single, single=single, rng=np.random.default_rng(len(shape)))
    height = (V[:, 1] - V[:, 1].min()) / np.ptp(V[:, 1])
    b = np.flatnonzero((height < 0.34) | (height > 0.66))
    target = V[b] + 0.1 * np.ptp(V, axis=0) * (height[b, None] > 0.5)
    if single:
        V, target = V.astype(np.float32), target.astype(np.float32)
    assert len(V) > mesh.n and np.ptp([V[origin == i][[0, -1]] for i in range(mesh.n)], axis=1).any()
    for options in ({"repair": True}, {}, {"method": "fine"}, {"method": "paper"}):
        moved = deform(V, F, b, target, vertices=120, **options)
        assert_together(moved, origin)
        assert np.abs(moved - V).max() > 0.05 * np.ptp(mesh.V[:, 1])


def assert_together(moved: np.ndarray, origin: np.ndarray) -> None:
    """All copies of a vertex, whose number is `origin` (n,), are exactly at one place."""
    place = np.full((origin.max() + 1, 3), np.nan)
    place[origin] = moved
    assert np.array_equal(moved, place[origin]), "copies of a vertex come apart"

"""Gaps between components that overlapped or nearly touched."""

import numpy as np
import pytest

from sshade import Mesh
from sshade.mesh.quality import NEAR, NearParts, surface_points
from tests.shapes import beside, block, icosphere, rotation, shifted, tube

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
    assert NearParts(icosphere(2)).gap(9 * icosphere(2).V) is None


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

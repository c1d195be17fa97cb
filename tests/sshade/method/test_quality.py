"""The line that judges a shape, against closed forms and against libigl's exact predicates."""

import numpy as np
import pytest

from eval.metrics.shape import intersecting_faces
from sshade import Deformer, Mesh
from sshade.mesh import quality as module
from sshade.mesh.boxes import crossing_faces
from sshade.mesh.quality import quality, worst
from tests.shapes import beside, bumpy, icosphere, shifted, tube

BODY = bumpy(3)
TWO = beside(icosphere(3), shifted(icosphere(3), [3, 0, 0]))


def test_stretch_and_volume_of_a_scaled_body_are_the_factor_and_its_cube():
    measure = Deformer(BODY, [0, 9], vertices=60).quality
    found = measure(1.1 * BODY.V + 5)
    assert found.stretch == pytest.approx(1.1) and found.volume == pytest.approx(1.1**3 - 1)
    words = "largest stretch 1.1, no new self-intersections, no flipped faces; 33 % more volume"
    assert str(found) == words
    assert str(measure(BODY.V)).endswith("volume kept")
    assert worst([found, measure(0.5 * BODY.V)]) == found._replace(volume=pytest.approx(-0.875))
    assert Deformer(tube(), [0, 9]).quality(tube().V).volume is None


def test_a_vertex_that_is_pushed_through_flips_the_faces_around_it():
    V, ring = BODY.V.copy(), (BODY.F == 7).any(axis=1)
    a, b = BODY.V[7], BODY.V[BODY.F[ring]].mean(axis=(0, 1))
    V[7] = a + 3 * (V[BODY.F[ring][0, 0]] - V[BODY.F[ring][0, 1]]) + (b - a)
    assert 0 < quality(BODY, V).flipped <= ring.sum() + 3


@pytest.mark.parametrize("shift", [0.0, 0.7, 1.5, 2.9])
def test_crossings_are_those_of_exact_predicates(shift):
    V = TWO.V - np.outer(TWO.V[:, 0] > 1.5, [shift, 0.011, 0.007])
    found = crossing_faces(V, TWO.F)
    assert np.array_equal(found, intersecting_faces(V, TWO.F))
    assert quality(TWO, V).crossings == found.sum() and (found.any() == (shift > 1))
    assert quality(Mesh(V, TWO.F), V).crossings == 0  # they are not new


def test_proxies_stand_for_a_large_mesh(monkeypatch):
    monkeypatch.setattr(module, "MEASURED", TWO.m - 1)
    V = TWO.V - np.outer(TWO.V[:, 0] > 1.5, [1.5, 0.011, 0.007])
    half = TWO.m // 2
    ends = np.arange(TWO.n // 2), np.arange(TWO.n // 2, TWO.n)
    proxies = [(ends[0], TWO.F[:half]), (ends[1], TWO.F[half:] - TWO.n // 2)]
    assert quality(TWO, V, proxies).crossings == crossing_faces(V, TWO.F).sum() > 0
    assert quality(TWO, V, proxies[:1]).crossings == 0
    assert quality(TWO, V).crossings > 0  # without proxies

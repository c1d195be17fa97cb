"""Moves along normals: exact volumes, limits, and vertices that stay."""

import numpy as np
import pytest

from sshade import Mesh
from sshade.method.normal_shift import shifted
from tests.shapes import bumpy

BODY = bumpy(3)
FACES = BODY.F.astype(np.uint32)


@pytest.mark.parametrize("ratio", [0.9, 1.0, 1.1])
def test_the_volume_is_reached(ratio):
    weight = np.where(BODY.V[:, 0] > 0, 1.0, 0.25)
    V = shifted(BODY.V, FACES, weight, ratio * BODY.volume, most=np.inf, error=1e-12)
    assert Mesh(V, BODY.F).volume == pytest.approx(ratio * BODY.volume, rel=1e-10)
    moved = np.linalg.norm(V - BODY.V, axis=1)
    assert moved == pytest.approx(weight * moved.max(), abs=1e-12)


def test_limits():
    weight = np.zeros(BODY.n)
    assert shifted(BODY.V, FACES, weight, 2 * BODY.volume, most=np.inf, error=1e-12) is BODY.V
    near = shifted(BODY.V, FACES, weight + 1, 2 * BODY.volume, most=0.01, error=1e-12)
    assert np.linalg.norm(near - BODY.V, axis=1) == pytest.approx(0.01)

import numpy as np
import pytest

from sshade.problem import snapping
from sshade.problem.snapping import snap_to_vertices
from tests.shapes import bumpy, strip, torus

SHAPES = {"bumpy": bumpy(4), "flat": strip(60, 40), "torus": torus(90, 30)}


@pytest.fixture(params=[1, 5, 10**9])
def large(request, monkeypatch):
    """From all vertices through a few to a mesh that is not large."""
    monkeypatch.setattr(snapping, "LARGE", 0 if request.param < 10**9 else 10**9)
    monkeypatch.setattr(snapping, "STRIDE", request.param)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("off", [0.0, 1e-3, 0.04])
def test_nearest_vertices_are_those_of_all_distances(name, off, large):
    mesh, rng = SHAPES[name], np.random.default_rng(7)
    source = mesh.V[rng.permutation(mesh.n)[:40]] + off * mesh.diagonal * rng.uniform(-0.5, 0.5, (40, 3))
    distance, index = snap_to_vertices(mesh, source, np.zeros(40, dtype=int))
    every = np.linalg.norm(mesh.V[None] - source[:, None], axis=2)
    assert np.array_equal(index, every.argmin(axis=1))
    np.testing.assert_allclose(distance, every.min(axis=1), rtol=1e-12, atol=1e-300)


def test_one_position_outside_of_the_box(large):
    mesh = SHAPES["bumpy"]
    source = mesh.V[[np.argmin(mesh.V[:, 0])]] - [0.03 * mesh.diagonal, 0, 0]
    _, index = snap_to_vertices(mesh, source, np.zeros(1, dtype=int))
    assert index[0] == np.argmin(np.linalg.norm(mesh.V - source, axis=1))

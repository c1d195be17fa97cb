"""The method interpolate: exact on affine maps, as SciPy interpolates, and recommended for dense handles."""

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from sshade import DeformationTask, Handles, Mesh, deform
from sshade.interpolation import dense_handles
from sshade.interpolation.splines import fit_splines, interpolate, neighbours
from sshade.regions.handle_regions import are_dense
from tests.shapes import bent, icosphere, rotation

BODY = Mesh(icosphere(4).V * [2.0, 1.0, 0.7], icosphere(4).F)


def turned(V: np.ndarray) -> np.ndarray:
    return V @ rotation().T + [3.0, 1.0, 2.0]


def task(f, count=400, *, mesh=BODY, seed=0, **changes) -> DeformationTask:
    """Random vertices as handles, moved by a map of space."""
    index = np.random.default_rng(seed).choice(mesh.n, count, replace=False)
    return DeformationTask("dense", mesh, Handles(index, f(mesh.V)[index], **changes))


def off(result, f, mesh=BODY) -> float:
    return float(np.abs(result.vertices - f(mesh.V)).max()) / mesh.diagonal


@pytest.mark.parametrize("f", [turned, lambda V: V * [1.3, 1, 0.8] + V[:, [1, 2, 0]] * [0, 0.2, 0] + 3])
def test_affine_maps_are_exact(f):
    for count in (12, 60, 400):
        assert off(deform(task(f, count), method="interpolate"), f) < 1e-9
    flat = np.flatnonzero(np.abs(BODY.V[:, 2]) < 1e-12)  # they determine a rotation
    lying = DeformationTask("flat", BODY, Handles(flat, turned(BODY.V)[flat]))
    assert off(deform(lying, method="interpolate"), turned) < 1e-9


def test_a_spline_is_the_one_of_scipy():
    x = np.random.default_rng(1).uniform(-1, 1, (30, 3))
    y, V = bent(x), np.random.default_rng(2).uniform(-0.7, 0.7, (200, 3))
    every = np.arange(len(x))
    splines = fit_splines(x, y, neighbours(x, every, every))
    oracle = RBFInterpolator(x, y, kernel="cubic", degree=1)(V)
    assert np.abs(interpolate(splines, V) - oracle).max() < 2e-5


def grown(V: np.ndarray) -> np.ndarray:
    return V * (1.05 + 0.05 * np.sin(V[:, :1]))


def test_an_elastic_surface_fights_dense_handles_that_change_the_volume():
    dense = task(grown)
    found = deform(dense, method="interpolate")
    assert off(found, grown) < 5e-4 and off(deform(dense), grown) > 3e-3
    assert np.array_equal(found.vertices[dense.handles.index], dense.handles.target)


def test_handles_all_over_the_surface_are_dense_and_regions_are_not():
    assert are_dense(task(bent, 600)) and not are_dense(task(bent, 60))
    ends = np.flatnonzero(np.abs(BODY.V[:, 0]) > 0.1)  # two regions with a thin band in between
    assert not are_dense(DeformationTask("ends", BODY, Handles(ends, bent(BODY.V)[ends])))
    assert not are_dense(task(bent, 600, weight=1.0))


def test_a_mesh_that_is_no_manifold_is_interpolated():
    bowtie = Mesh(BODY.V, np.concatenate([BODY.F, [[0, 900, 1800]]]))
    assert off(deform(task(bent, 300, mesh=bowtie), method="interpolate"), bent, bowtie) < 2e-3


def test_a_node_as_far_from_all_centres_has_a_share_of_one():
    """The corners of a cube are equally far from its middle, where a node of the grid lies."""
    x = np.stack(np.meshgrid([-1.0, 1], [-1.0, 1], [-1.0, 1]), axis=-1).reshape(-1, 3)
    A, every = rotation(2) * [1, 2, 3], np.arange(8)
    splines = fit_splines(x, x @ A.T, neighbours(x, every, every))
    V = np.outer([-1.0, 0, 1], [1, 0, 0])
    np.testing.assert_allclose(interpolate(splines, V), V @ A.T, atol=1e-12)


def test_splines_of_some_handles_are_spread_over_all(monkeypatch):
    monkeypatch.setattr(dense_handles, "SPLINES", 100)
    index = np.argsort(BODY.V[:, 0])[::3]
    found = deform(BODY.V, BODY.F, index, bent(BODY.V)[index], method="interpolate")
    assert np.abs(found - bent(BODY.V)).max() < 0.01 * BODY.diagonal

"""Every method deforms a mesh with faces without area as if these faces were not there."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baselines.accelerated import local_global
from sshade import DeformationTask, Mesh
from sshade.solver.laplacian import SLACK, half_cotangents
from tests.shapes import QUARTER, bumpy, end_handles
from tests.sshade.method.calls import fast, fine, paper

BODY, SMALL = bumpy(3), bumpy(2)
METHODS = {"sshade": partial(paper, samplings=2), "fast": fast, "fine": fine, "full resolution": local_global}


def flattened(seed: int) -> Mesh:
    """Move a corner of some faces of SMALL onto the opposite edge, at an end or between the ends."""
    rng = np.random.default_rng(seed)
    a, b, c = SMALL.F[rng.choice(SMALL.m, SMALL.m // 8, replace=False)].T
    share = rng.choice([0.0, 1.0, 0.3, 0.5], len(a))[:, None]
    V = SMALL.V.copy()
    V[a] = V[b] + share * (V[c] - V[b])
    return Mesh(V, SMALL.F)


def posed(mesh: Mesh, n: int) -> DeformationTask:
    """Return a task with handles at both ends along z, chosen from the first n vertices."""
    return DeformationTask("ends", mesh, end_handles(mesh.V[:n], turn=QUARTER, shift=[0, 0, 0.2]))


def check_collapsed(method):
    """Assert that coincident vertices stay together, and that distant vertices move as in a sound mesh."""
    rng = np.random.default_rng(3)
    V = np.array(BODY.V)
    picked = BODY.F[rng.choice(np.flatnonzero((np.abs(V[BODY.F][:, :, 2]) < 1).all(axis=1)), 12)]
    V[picked[:6, 1]] = V[picked[:6, 0]]
    V[picked[6:, 1:]] = V[picked[6:, :1]]
    mesh = Mesh(V, BODY.F)
    sound, flat = (method(posed(m, BODY.n)) for m in (BODY, mesh))
    a, b = mesh.edges[np.linalg.norm(V[mesh.edges[:, 0]] - V[mesh.edges[:, 1]], axis=1) == 0].T
    assert len(a) > 15
    assert np.linalg.norm(flat.vertices[a] - flat.vertices[b], axis=1).max() < 0.005 * mesh.diagonal
    far = np.setdiff1d(np.arange(BODY.n), BODY.F[mesh.without_area])
    assert np.linalg.norm((sound.vertices - flat.vertices)[far], axis=1).max() < 0.03 * mesh.diagonal
    return flat, mesh.without_area.sum()


@pytest.mark.parametrize("name", METHODS)
def test_every_method_takes_collapsed_edges_and_faces(name):
    flat, count = check_collapsed(METHODS[name])
    if name != "full resolution":
        assert flat.facts.faces_without_area == count > 12


@given(seed=st.integers(0, 2**32 - 1))
def test_half_cotangents_are_bounded_and_those_of_sound_faces_stay(seed):
    flat = flattened(seed)
    h = half_cotangents(flat)
    assert np.abs(h).max() <= 0.5 / SLACK + 1
    sound = ~flat.without_area
    used, F = np.unique(flat.F[sound], return_inverse=True)
    alone = Mesh(flat.V[used], F.reshape(-1, 3))
    assert np.array_equal(h[sound], half_cotangents(alone))
    # The sum of h e e^T over a face is not negative for any edges e that close, as in a real triangle.
    u = np.random.default_rng(0).normal(size=(50, 3))
    squared = (u - np.roll(u, -1, axis=1)) ** 2
    assert (squared @ h.T).min() > -1e-9 * np.abs(h).max()

"""Edits: moved region, smoothness, and independence of unit, place and resolution."""

import numpy as np
import pytest

from defaust.edits import Fin, Horns, Inflate, Stretch
from sshade import InputError, Mesh
from tests.shapes import beside, bumpy, icosphere, shifted, strip

EDITS = [
    Inflate(at=(0.5, 0.5, 1.0), radius=0.2, amount=0.05),
    Stretch(at=(0.5, 0.5, 1.0), radius=0.3, amount=0.1),
    Horns(at=((0.5, 0.5, 1.0), (1.0, 0.5, 0.5)), radius=0.1, height=0.1),
    Fin(start=(0.5, 0.5, 1.0), end=(1.0, 0.5, 0.5), width=0.06, height=0.05),
]


@pytest.mark.parametrize("edit", EDITS, ids=lambda edit: edit.name)
def test_a_region_moves_smoothly_and_the_rest_stays_whatever_unit_and_place(edit):
    mesh = bumpy(5)
    V = edit(mesh)
    moved = np.linalg.norm(V - mesh.V, axis=1) / mesh.diagonal
    length = getattr(edit, "amount", None) or edit.height
    assert 0.8 * length < moved.max() < 1.01 * length
    assert 0.001 < (moved > 0).mean() < 0.3
    low, high = mesh.V.min(axis=0), mesh.V.max(axis=0)
    for at in np.atleast_2d(getattr(edit, "at", np.empty((0, 3)))):  # each place moves
        assert moved[np.linalg.norm(mesh.V - low - at * (high - low), axis=1).argmin()] > 0.8 * length
    # Neighbours move alike: no step at the border of the region.
    step = np.abs(np.diff(moved[mesh.edges], axis=1)).ravel()
    assert step[(moved[mesh.edges] == 0).any(axis=1)].max() < 0.05 * length
    edited = Mesh(V, mesh.F)
    assert edited.volume > mesh.volume
    assert (np.einsum("ij,ij->i", edited.face_normals, mesh.face_normals) > -0.9).all()
    scaled = Mesh(8 * mesh.V + [5.0, -3, 2], mesh.F)
    np.testing.assert_allclose(edit(scaled), 8 * V + [5.0, -3, 2], atol=1e-8)


def test_only_the_connected_region_moves():
    """A limb beside the edited limb stays, however near it is."""
    flat = strip(40, 1)
    folded = flat.V.copy()
    half = flat.V[:, 0] > 20
    folded[half] = np.stack([40 - flat.V[half, 0], flat.V[half, 1], np.full(half.sum(), 0.5)], axis=1)
    mesh = Mesh(folded, flat.F)
    moved = Stretch(at=(0.0, 0.0, 1.0), radius=0.2, amount=0.1)(mesh) != mesh.V
    assert moved.any() and not moved[~half].any()


TWO_BALLS = beside(icosphere(1), shifted(icosphere(1), [5.0, 0, 0]))


DO_NOT_FIT = {
    "moves one vertex of this mesh": lambda: Stretch(at=(0.5, 0.5, 1.0), radius=1e-6, amount=0.1)(TWO_BALLS),
    "same component": lambda: Fin((0, 0.5, 0.5), (1, 0.5, 0.5), width=0.1, height=0.1)(TWO_BALLS),
    "at the same vertex": lambda: Fin((0, 0, 0), (0, 0, 0), width=0.1, height=0.1)(TWO_BALLS),
    "has no direction": lambda: Stretch(at=(0.5, 0.5, 0.5), radius=0.2, amount=0.1)(strip(20, 20)),
}


@pytest.mark.parametrize("words", DO_NOT_FIT)
def test_edits_that_do_not_fit_are_refused(words):
    with pytest.raises(InputError, match=words):
        DO_NOT_FIT[words]()

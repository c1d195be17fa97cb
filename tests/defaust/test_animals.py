"""The animals: their asset, and the tool that baked it."""

import numpy as np
import pytest

from defaust.build.upsample import self_intersecting
from defaust.sources.animals import SPECIES, Animals, arrays_of, load_animal
from tools.bake.animals import bone_weights, find_landmarks, make_poses, read_table
from tools.bake.capsules import make_rig
from tools.bake.template import quantise_weights

SUBJECTS = range(len(SPECIES))


@pytest.mark.parametrize("subject", SUBJECTS)
def test_animals_are_closed_without_handles_or_intersections_at_rest(subject):
    rest = Animals().rest(subject)
    assert rest.is_closed and rest.is_manifold and rest.is_oriented and rest.volume > 0
    assert rest.topology == (2, 1, 0)
    assert not self_intersecting(rest).any()
    assert rest.n == pytest.approx(read_table()[SPECIES[subject]]["vertices"], rel=0.05)
    assert rest.V[:, 1].min() == pytest.approx(0.0, abs=0.01 * rest.diagonal)


@pytest.mark.parametrize("species", SPECIES)
def test_weights_poses_and_landmarks_of_the_asset_can_be_baked_again(species):
    arrays, animal, table = arrays_of(species), load_animal(species), read_table()[species]
    rig = make_rig(table)
    V, F = animal.rest[0], animal.faces
    # The vertices lie on the surface of the formulas.
    assert np.abs(rig.level(V)).max() < 0.01 * np.linalg.norm(np.ptp(V, axis=0))
    bone, weight = quantise_weights(bone_weights(rig, V, F), keep=arrays["bone"].shape[1])
    assert np.abs(weight.astype(int) - arrays["weight"]).max() <= 1
    rotations, shifts = make_poses(rig, table["poses"])
    np.testing.assert_allclose(rotations, arrays["rotations"], atol=1e-6)
    np.testing.assert_allclose(shifts, arrays["shifts"], atol=1e-6)
    assert find_landmarks(V, table["landmarks"]) == dict(animal.landmarks)

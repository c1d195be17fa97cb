"""The animals: their asset, and the tool that baked it."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from defaust.build.upsample import self_intersecting
from defaust.sources.animals import SPECIES, Animals, arrays_of, load_animal, unpack
from defaust.sources.winding import same_triangles
from sshade import Mesh
from tests.shapes import bumpy, torus
from tools.bake.animals import STEPS, bone_weights, find_landmarks, make_poses, pack, read_table
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


@pytest.mark.parametrize("mesh", [bumpy(3), torus()], ids=["bumpy", "torus"])
def test_packing_renumbers_and_moves_no_coordinate_by_more_than_half_a_step(mesh):
    mesh = Mesh(3.0 * mesh.V - 5.0, mesh.F)
    V, F = unpack(pack(mesh))
    step = np.ptp(mesh.V, axis=0).max() / STEPS
    _, old = cKDTree(mesh.V).query(V)
    assert sorted(old) == list(range(mesh.n))
    assert np.abs(V - mesh.V[old]).max() <= (0.5 + 1e-6) * step
    assert same_triangles(old[F], mesh.F) and Mesh(V, F).volume == pytest.approx(mesh.volume, rel=1e-4)

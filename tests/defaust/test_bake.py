"""The tool that baked the synthetic bodies. Its source files are not in the repository."""

import numpy as np

from defaust.sources.noisy import bone_rotations, pose_names
from defaust.sources.source import read_asset
from defaust.sources.synthetic import SHA256, load_bodies
from tools.bake import noisy
from tools.bake.__main__ import add_poses, without_reaches
from tools.bake.morphs import BONES


def test_the_shipped_poses_can_be_baked_again_from_the_shipped_bodies():
    arrays = read_asset("bodies", sha256=SHA256)
    first = arrays | {name: arrays[name][:1] for name in ("offset", "joints", "rotations", "shifts")}
    kept = without_reaches(first)
    assert kept["rotations"].shape == (1, 4, len(BONES), 3) and kept["shifts"].shape == (1, 4, 3)
    again = add_poses(kept)
    assert again.keys() == arrays.keys()
    np.testing.assert_array_equal(again["pose_names"], arrays["pose_names"])
    for name in ("rotations", "shifts"):
        np.testing.assert_array_equal(again[name][:, :4], first[name][:, :4])
        np.testing.assert_allclose(again[name], first[name], atol=1e-4)


def test_a_pose_of_the_noisy_bodies_can_be_baked_again():
    name = pose_names(5)[0]
    rotations, shift = noisy.make_pose(
        load_bodies(), subject=5, pose=noisy.POSES["others"][name], seed=[noisy.SEED, 5, 0]
    )
    for found, shipped in zip((rotations, shift), bone_rotations(5, name), strict=True):
        np.testing.assert_allclose(found, shipped, atol=1e-3)
    assert [list(poses) for poses in noisy.POSES.values()] == [pose_names(0), pose_names(9)]

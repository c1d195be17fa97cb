"""Ground truth at high resolution, by skinning and by subdivision."""

import numpy as np
import pytest

from defaust.build.options import BuildOptions
from defaust.build.upsample import subdivide, upsample
from defaust.sources.synthetic import SHA256, SyntheticBodies, load_bodies
from defaust.tasks.full_size import Registered, find_skin, true_pose
from sshade import Mesh
from tests.shapes import bumpy, rotation


@pytest.fixture(scope="module")
def body():
    source = SyntheticBodies()
    return source.rest(3), [source.posed(3, pose) for pose in source.poses(3)]


@pytest.fixture(scope="module")
def fine(body):
    """The rest mesh subdivided once: 27,554 vertices, of which the first 6,890 are moved old ones."""
    return subdivide(body[0], steps=1)


def test_skinned_and_subdivided_poses_of_a_fine_mesh_agree(body, fine):
    rest, poses = body
    for name, posed in list(zip(load_bodies().pose_names, poses, strict=True))[::2]:
        meshes = Registered(fine, rest, rest, 1)
        skinned = find_skin(meshes, {"asset_sha256": SHA256}, subject=3, pose=name)(fine.V)
        subdivided = true_pose(Registered(fine, rest, posed, 1), None)[0]
        gap = np.linalg.norm(skinned - subdivided, axis=1)
        assert gap.mean() < 3e-4 and gap.max() < 5e-3  # metres; the largest in a crease
        moved = np.linalg.norm(skinned - fine.V, axis=1)
        assert moved.max() > 0.3


def test_a_subdivided_mesh_goes_to_the_subdivided_pose():
    """A remeshed surface lies on the subdivided one, where every point has its place in the pose."""
    low = bumpy(2)
    posed = Mesh(low.V @ rotation(4).T * 2 + 1, low.F)
    remeshed = upsample(low, BuildOptions(target_vertices=700, ls3_steps=1)).mesh
    found, _ = true_pose(Registered(remeshed, low, posed, 1), None)
    np.testing.assert_allclose(found, remeshed.V @ rotation(4).T * 2 + 1, atol=1e-6)

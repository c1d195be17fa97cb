"""A mesh bound to a proxy: invariances of each kind of frames, and binding files."""

import numpy as np
import pytest

from sshade import InputError, Mesh, bind, load_binding, save_binding
from sshade.proxy.binding import FrameKind
from sshade.proxy.triangle import TriangleFrames, frame_values
from tests.shapes import bent, family, rotation

#: Largest difference of positions due to rounding, as a fraction of the bounding-box diagonal.
ROUNDING = 1e-12

MESHES = family()
BUMPY = MESHES["bumpy"]
KINDS: list[FrameKind] = ["triangle", "blended"]


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("kind", KINDS)
def test_an_undeformed_and_a_rigidly_moved_proxy_carry_the_mesh_exactly(name, kind):
    mesh, turn, shift = MESHES[name], rotation(1), np.array([3.0, -1, 2])
    binding = bind(mesh, mesh.n // 6, frames=kind)
    for R, t in ((np.eye(3), np.zeros(3)), (turn, shift)):
        given = np.broadcast_to(R, (binding.proxy.n, 3, 3))
        for rotations in (None, given):
            V, degenerate = binding.carry(binding.proxy.V @ R.T + t, rotations=rotations)
            assert degenerate == 0
            assert np.abs(V - (mesh.V @ R.T + t)).max() <= ROUNDING * mesh.diagonal


def test_a_mesh_far_from_the_origin_is_bound_as_near_it():
    mesh = Mesh(np.round(BUMPY.V * 2**20) / 2**20, BUMPY.F)
    near, far = bind(mesh, 80), bind(Mesh(mesh.V + 2.0**30, mesh.F), 80)
    assert np.array_equal(near.projection.face, far.projection.face)
    np.testing.assert_allclose(near.projection.barycentric, far.projection.barycentric, atol=1e-12)


def test_a_linear_function_on_the_proxy_has_its_values_at_the_projections():
    binding = bind(BUMPY, 80)
    linear = binding.proxy.V @ np.arange(6.0).reshape(3, 2) + [1, -2]
    found = binding.prolong(linear)
    corners = binding.proxy.V[binding.proxy.F[binding.projection.face]]
    points = sum(binding.projection.barycentric[:, [c]] * corners[:, c] for c in range(3))
    np.testing.assert_allclose(found, points @ np.arange(6.0).reshape(3, 2) + [1, -2], atol=1e-12)
    np.testing.assert_allclose(found[binding.sampling.samples], linear, atol=1e-12)  # samples keep theirs
    np.testing.assert_allclose(binding.prolong(linear[:, 0]), found[:, 0], atol=1e-12)
    for wrong in (linear[:-1], linear[0, 0], linear[:, :, None]):
        with pytest.raises(InputError, match="the proxy has 80 vertices"):
            binding.prolong(wrong)


def along_x(proxy: Mesh, samples: np.ndarray) -> TriangleFrames:
    """Frames of the user: triangle frames with another function."""
    return TriangleFrames.of_values(proxy, frame_values(proxy, 0))


@pytest.mark.parametrize("frames", [*KINDS, along_x])
def test_a_binding_read_back_has_its_frames_or_those_that_are_asked_for(tmp_path, frames):
    binding = bind(BUMPY, 80, frames=frames)
    save_binding(tmp_path / "map.npz", binding)
    assert [p.name for p in tmp_path.iterdir()] == ["map.npz"]
    NV = bent(binding.proxy.V)
    again = load_binding(tmp_path / "map.npz", BUMPY)
    assert again.frames.name == binding.frames.name
    assert np.array_equal(binding.carry(NV)[0], again.carry(NV)[0])
    assert np.array_equal(binding.projection.barycentric, again.projection.barycentric)
    for other in (*KINDS, along_x):
        asked = load_binding(tmp_path / "map.npz", BUMPY, frames=other)
        saved = frames if other == "triangle" == binding.frames.name else other  # with its function
        direct = bind(BUMPY, 80, frames=saved)
        assert asked.frames.name == direct.frames.name
        assert np.array_equal(asked.carry(NV)[0], direct.carry(NV)[0])


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("region", lambda cell: cell + 40),
        ("region", lambda _: None),
        ("samples", lambda samples: samples.astype(float)),
        ("distance", lambda distance: distance[1:]),
        ("frames", lambda _: np.array("quaternion")),
    ],
)
def test_a_map_whose_arrays_do_not_fit_together_is_refused(tmp_path, name, change):
    save_binding(tmp_path / "map.npz", bind(BUMPY, 40))
    with np.load(tmp_path / "map.npz") as stored:
        arrays = dict(stored)
    arrays[name] = change(arrays[name])
    np.savez(tmp_path / "map.npz", **{key: array for key, array in arrays.items() if array is not None})
    with pytest.raises(InputError, match=r"map\.npz: "):
        load_binding(tmp_path / "map.npz", BUMPY)

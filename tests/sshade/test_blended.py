"""Frames at the proxy's vertices, blended over its triangles; and affine maps of triangles."""

from __future__ import annotations

import numpy as np
import pytest

from sshade import InputError, bind
from tests.shapes import bent, bumpy, family, rotation

#: Positions agree to rounding: this times the bounding-box diagonal.
ROUNDING = 1e-12

MESHES = family()
KINDS = ["affine", "blended", "blended_affine"]


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("kind", KINDS)
def test_an_undeformed_and_a_moved_proxy_carry_the_mesh_exactly(name, kind):
    mesh, turn, shift = MESHES[name], rotation(1), np.array([3.0, -1, 2])
    binding = bind(mesh, mesh.n // 6, frames=kind)
    for R, t in ((np.eye(3), np.zeros(3)), (turn, shift)):
        V, degenerate = binding.carry(binding.proxy.V @ R.T + t)
        assert degenerate == 0
        assert np.abs(V - (mesh.V @ R.T + t)).max() <= ROUNDING * mesh.diagonal


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("kind", ["blended", "blended_affine"])
def test_samples_go_where_their_proxy_vertices_go(name, kind):
    mesh = MESHES[name]
    binding = bind(mesh, mesh.n // 6, frames=kind)
    NV = bent(binding.proxy.V, 0.5) @ rotation(2).T
    assert np.array_equal(binding.carry(NV)[0][binding.remesh.samples], NV)


def test_unknown_frames_and_rotations_that_do_not_fit_are_refused():
    mesh = bumpy(2)
    with pytest.raises(InputError, match="unknown frames 'rigid'; use one of triangle, affine, blended"):
        bind(mesh, 40, frames="rigid")
    binding = bind(mesh, 40, frames="blended")
    with pytest.raises(InputError, match=r"needs rotations of shape \(\d+, 3, 3\), not \(3, 3\)"):
        binding.carry(binding.proxy.V, rotations=np.eye(3))

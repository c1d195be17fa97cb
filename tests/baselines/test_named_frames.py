"""Frames of the ablations: affine ones, and triangle frames with other functions f."""

import numpy as np
import pytest

from baselines.ablations.affine_frames import AffineFrames, StretchingFrames
from baselines.ablations.named_frames import named_frames
from baselines.ablations.replaced import paper_with, transfer_with
from sshade import InputError, Mesh, TransferTask, bind, deform
from sshade.method.transfer import transfer
from sshade.proxy.blended import nearest_rotations
from sshade.proxy.triangle import TriangleFrames
from sshade.proxy.vertex_maps import VertexMaps
from tests.shapes import bent, block, bumpy, family, held_ends, jittered, rotation
from tests.sshade.proxy.test_blended import collapsed_and_turned, one_by_one, points_on

#: Largest difference of positions due to rounding, as a fraction of the bounding-box diagonal.
ROUNDING = 1e-12
MESHES = family()
KINDS = ("affine", "blended_affine")
#: Every value of the options `frames` and `frame_function` that `sshade` does not have.
OTHERS = [*((kind, "extent") for kind in KINDS), *(("triangle", f) for f in ("best", "x", "y", "z"))]


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("kind", KINDS)
def test_an_undeformed_and_a_rigidly_moved_proxy_carry_the_mesh_exactly(name, kind):
    mesh = MESHES[name]
    binding = bind(mesh, mesh.n // 6, frames=named_frames(kind))
    for R, t in ((np.eye(3), np.zeros(3)), (rotation(1), np.array([3.0, -1, 2]))):
        V, degenerate = binding.carry(binding.proxy.V @ R.T + t)
        assert degenerate == 0
        assert np.abs(V - (mesh.V @ R.T + t)).max() <= ROUNDING * mesh.diagonal


def test_the_affine_map_of_a_triangle_is_linear_interpolation_in_it_and_a_length_across():
    proxy = bumpy(2)
    NV, on = bent(proxy.V, 0.5), points_on(proxy, 300)
    frames = AffineFrames(proxy)
    inside = np.einsum("nc,ncx->nx", on.barycentric, proxy.V[proxy.F[on.face]])
    V = inside + 0.3 * proxy.face_normals[on.face]
    expected = np.einsum("nc,ncx->nx", on.barycentric, NV[proxy.F[on.face]])
    expected += 0.3 * Mesh(NV, proxy.F).face_normals[on.face]
    moved, missing = frames.decode(frames.encode(V, on), NV, on=on)
    assert missing == 0
    np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-12)


def test_stretching_frames_follow_the_definition_and_keep_samples_to_the_last_bit():
    proxy = bumpy(1)
    on, rng = points_on(proxy, 60), np.random.default_rng(1)
    V = np.einsum("nc,ncx->nx", on.barycentric, proxy.V[proxy.F[on.face]]) + 0.1 * rng.normal(size=(60, 3))
    NV = bent(proxy.V, 0.5) @ rotation(3).T
    A, _ = VertexMaps.at_rest(proxy)(NV)
    R = nearest_rotations(A)
    S = R.transpose(0, 2, 1) @ A
    frames, local = StretchingFrames(proxy), StretchingFrames(proxy).encode(V, on)
    moved, missing = frames.decode(local, NV, on=on)
    assert missing == 0
    np.testing.assert_allclose(moved, one_by_one(proxy, V, on=on, NV=NV, R=R, S=S), rtol=0, atol=1e-12)
    given = np.broadcast_to(np.eye(3), R.shape)  # is unused
    assert np.array_equal(frames.decode(local, NV, on=on, rotations=given)[0], moved)
    binding = bind(bumpy(3), 100, frames=named_frames("blended_affine"))
    NV = bent(binding.proxy.V, 0.5) @ rotation(2).T
    assert np.array_equal(binding.carry(NV)[0][binding.sampling.samples], NV)


@pytest.mark.parametrize("kind", KINDS)
def test_collapsed_parts_of_the_proxy_are_counted(kind):
    binding = bind(bumpy(3), 100, frames=named_frames(kind))
    V, missing = binding.carry(collapsed_and_turned(binding.proxy)[0])
    assert 0 < missing < (40 if kind == "affine" else 20) and np.isfinite(V).all()


def test_other_functions_are_the_steepest_coordinate_and_named_coordinates():
    # Where a coordinate has hardly a gradient, another one replaces it.
    mesh = jittered(block(np.ones((2, 3, 5)), cells=2), 0.03)
    steepest = np.argmin(np.abs(mesh.face_normals), axis=1)
    for name, axis in (("best", steepest), ("x", 0), ("y", 1), ("z", 2)):
        frames, axis = named_frames("triangle", name)(mesh, np.arange(mesh.n)), np.broadcast_to(axis, mesh.m)
        assert isinstance(frames, TriangleFrames)
        kept = 1 - mesh.face_normals[np.arange(mesh.m), axis] ** 2 > 0.1**2
        assert kept.any() and kept.all() == (name == "best")
        own = mesh.V[mesh.F, axis[:, None]]
        assert np.array_equal((frames.values == own).all(axis=1), kept)


@pytest.mark.parametrize(("kind", "function"), OTHERS)
def test_paper_and_transfers_have_the_frames_that_are_named(kind, function):
    mesh, maker = bumpy(3), named_frames(kind, function)
    task, options = held_ends(mesh), {"vertices": 150, "samplings": 2}
    own = deform(task, method="paper", **options).vertices
    expected = deform(task, method="paper", frames=maker, **options).vertices
    found = paper_with(task, frames=kind, frame_function=function, **options).vertices
    # The coordinate of largest extent is one of x, y and z.
    extent = "xyz"[np.argmax(np.ptp(mesh.V, axis=0))]
    assert np.array_equal(found, expected) and np.array_equal(found, own) == (function == extent)
    edited = Mesh(mesh.V + 0.05 * np.sin(5 * mesh.V[:, [1, 2, 0]]), mesh.F)
    task, options = TransferTask("t", edited, mesh, bent(mesh.V)), {"vertices": 150, "samplings": 1}
    for residual in (False, True):
        expected = transfer(task, frames=maker, residual=residual, **options).vertices
        named = {"frames": kind, "frame_function": function, "residual": residual}
        assert np.array_equal(transfer_with(task, **named, **options).vertices, expected)


def test_names_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="no frames 'affine' with the function .*blended extent, "):
        named_frames("affine", "x")

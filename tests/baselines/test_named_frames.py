"""Frames of the ablations: affine ones, and triangle frames with other functions f."""

import numpy as np
import pytest

from baselines.ablations.affine_frames import AffineFrames
from baselines.ablations.named_frames import named_frames
from baselines.ablations.replaced import paper_with, transfer_with
from sshade import InputError, Mesh, TransferTask, deform
from sshade.method.transfer import transfer
from sshade.proxy.triangle import TriangleFrames
from tests.shapes import bent, block, bumpy, held_ends, jittered
from tests.sshade.proxy.test_binding import points_on

KINDS = ("affine", "blended_affine")
#: Every value of the options `frames` and `frame_function` that `sshade` does not have.
OTHERS = [*((kind, "extent") for kind in KINDS), *(("triangle", f) for f in ("best", "x", "y", "z"))]


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
    task, options = held_ends(mesh), {"vertices": 150, "samplings": 2, "seed": 4}
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

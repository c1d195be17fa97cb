"""Pose transfer as a task, and the method that carries it out."""

from __future__ import annotations

import numpy as np
import pytest

from sshade import InputError, Mesh, TransferTask, reconstruct, transfer_pose
from sshade.pipeline.transfer_task import transfer
from tests.shapes import bent, bumpy


@pytest.fixture(scope="module")
def task():
    rest = bumpy(3)
    edited = Mesh(rest.V + 0.05 * np.sin(5 * rest.V[:, [1, 2, 0]]), rest.F)
    return TransferTask("t", edited, rest, bent(rest.V), truth=bent(edited.V))


@pytest.mark.parametrize("frames", ["triangle", "blended_affine"])
def test_the_method_is_the_function(task, frames):
    options = {"vertices": 150, "samplings": 2, "frames": frames, "seed": 5}
    expected = transfer_pose(task.rest, task.posed, task.mesh.V, **options).vertices
    assert np.array_equal(transfer(task, **options).vertices, expected)
    isometric = TransferTask("i", task.rest, task.rest, task.posed, truth=task.posed)
    expected = reconstruct(task.rest, task.posed, **options).vertices
    assert np.array_equal(transfer(isometric, **options).vertices, expected)


def test_every_parameter_reaches_the_function(task):
    base = {"vertices": 150, "samplings": 1}
    shape = transfer(task, **base).vertices
    for changed in (
        {"vertices": 100},
        {"samplings": 2},
        {"frames": "affine"},
        {"frame_function": "x"},
        {"projection": "surface"},
        {"residual": True},
        {"seed": 1},
    ):
        assert not np.array_equal(transfer(task, **base | changed).vertices, shape)
    with pytest.raises(InputError, match="at least one is needed"):
        transfer(task, workers=0)
    calls = []
    transfer(task, **base, progress=lambda *args: calls.append(args))
    assert calls


def test_shapes_that_do_not_correspond_are_refused(task):
    rest, posed = task.rest, task.posed
    with pytest.raises(InputError, match="other faces than the rest shape"):
        TransferTask("t", Mesh(rest.V, rest.F[:, [1, 2, 0]]), rest, posed)
    for name in ("posed", "truth"):
        with pytest.raises(InputError, match=f"the {name} shape has vertices of shape .*must correspond"):
            TransferTask("t", rest, rest, **{"posed": posed, name: posed[1:]})
        broken = posed.copy()
        broken[3, 1] = np.nan
        with pytest.raises(InputError, match=f"{name} shape has a NaN or infinite"):
            TransferTask("t", rest, rest, **{"posed": posed, name: broken})

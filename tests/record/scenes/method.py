"""Deformations: methods, options, handles and surfaces of all kinds."""

from dataclasses import replace

import numpy as np

from sshade import (
    DeformationTask,
    Handles,
)
from tests.record.scenes.scene import BODY, LIMB, Values, patches, scene, solved
from tests.shapes import bent, beside, bumpy, end_handles, rotation, shifted, strip
from tests.sshade.mesh.test_cutting import moebius, t_fin


@scene
def fast() -> Values:
    yield from solved(patches(), vertices=400)


@scene
def fine() -> Values:
    yield from solved(patches(LIMB, 30), method="fine", vertices=300)


@scene
def paper() -> Values:
    yield from solved(patches(), method="paper", vertices=300, samplings=3)
    yield from solved(
        patches(), method="paper", vertices=200, samplings=1, accelerate=False, max_iterations=9
    )


@scene
def regions() -> Values:
    yield from solved(patches(count=500), vertices=400)
    yield from solved(patches(LIMB, 600), method="fine", vertices=300, thickness=0.5)


@scene
def soft_and_turned() -> Values:
    yield from solved(patches(weights=[np.inf, 3.0]), vertices=300)
    rotations = [None, rotation(4)]
    yield from solved(patches(LIMB, 4, rotations=rotations, weights=[np.inf, 20.0]), vertices=300, joints=0)
    yield from solved(patches(LIMB, 1, rotations=rotations), method="fine", vertices=200)


@scene
def options() -> Values:
    task = patches(count=8)
    yield from solved(task, vertices=200, volume_goal=1.15)
    yield from solved(task, vertices=200, samplings=2, seed=3, volume=1.0, area=1.0)
    yield from solved(task, vertices=200, frames="triangle", bending=0.05, strain_limit=0.1, start="rest")
    yield from solved(task, vertices=200, method="fine", detail=0.9, polish_iterations=7)
    yield from solved(replace(task, guess=bent(task.mesh.V, 0.05)), vertices=200, workers=2)


@scene
def dense() -> Values:
    index = np.arange(0, BODY.n, 5)
    task = DeformationTask("t", BODY, Handles(index, bent(BODY.V)[index]))
    yield from solved(task, method="interpolate")
    yield from solved(task, vertices=400)


@scene
def components() -> Values:
    small = bumpy(3)
    mesh = beside(small, shifted(small, [4, 0, 0]), shifted(bumpy(2), [2, 3, 0]), shifted(small, [0, 0, 9]))
    own = end_handles(small.V, count=8, shift=[0.3, 0, 0.2])
    index = np.concatenate([own.index, own.index + small.n])
    target = np.concatenate([own.target, mesh.V[own.index + small.n] + [0, 0.5, 0]])
    group = np.repeat([0, 1, 2], [8, 8, 16])
    yield from solved(DeformationTask("t", mesh, Handles(index, target, group=group)), vertices=300)


@scene
def cut() -> Values:
    for mesh in (t_fin(8), moebius(60), strip(40, 8)):
        axis = int(np.argmax(np.ptp(mesh.V, axis=0)))
        task = DeformationTask("t", mesh, end_handles(mesh.V, axis=axis, shift=0.2 * np.ptp(mesh.V, axis=0)))
        yield from solved(task, vertices=100)
        yield from solved(task, vertices=100, method="fine", polish_iterations=5)


@scene
def memory() -> Values:
    """A mesh that is large beside its proxy."""
    yield from solved(patches(bumpy(6), 40), vertices=100, max_iterations=3)


@scene
def memory_of_fine() -> Values:
    yield from solved(
        patches(bumpy(5), 40), vertices=100, method="fine", max_iterations=3, polish_iterations=3
    )

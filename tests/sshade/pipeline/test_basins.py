"""Poses with more than one minimum: the method ends in none that is much above the lowest that is found.

Four starts are compared: at rest, rigid, at the minimum that leads, and handles taken to their targets in
steps along the rigid motions of their groups. Further turns are not among the poses: a tube whose ends are
turned by 175 degrees has a minimum of half the energy, to which the rest leads, but it runs through itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sshade import DeformationTask, Handles, Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.options import SOLVER, resolve
from sshade.pipeline.engine import solve_proxy
from sshade.solver.local_global import local_global
from tests.shapes import block, bumpy, jittered, tube

ITERATIONS = 400
#: A group: its vertices, its turn in degrees, and where its centre goes.
Group = tuple[np.ndarray, Sequence[float], np.ndarray]


def posed(name: str, mesh: Mesh, groups: list[Group], points: int | None) -> DeformationTask:
    """Groups of handles as regions, or some vertices of each."""
    rng, index, target = np.random.default_rng(0), [], []
    for vertices, turn, centre in groups:
        own = vertices if points is None else rng.choice(vertices, points, replace=False)
        c = mesh.V[vertices].mean(axis=0)
        index.append(own)
        target.append(Rotation.from_rotvec(turn, degrees=True).apply(mesh.V[own] - c) + centre)
    number = np.repeat(np.arange(len(groups)), [len(own) for own in index])
    handles = Handles(np.concatenate(index), np.concatenate(target), group=number)
    return DeformationTask(name, mesh, handles)


def head_turned(points: int | None) -> DeformationTask:
    mesh = bumpy(3)
    z = mesh.V[:, 2]
    low, head = np.flatnonzero(z < np.quantile(z, 0.2)), np.flatnonzero(z > np.quantile(z, 0.85))
    groups = [(own, (0, 0, turn), mesh.V[own].mean(axis=0)) for own, turn in ((low, 0), (head, 150))]
    return posed("head", mesh, groups, points)


def arm_raised(points: int | None) -> DeformationTask:
    """Past the head."""
    solid = np.zeros((8, 2, 7))
    solid[:2], solid[2:, :, 3:5] = 1, 1
    mesh = jittered(block(solid, cells=2), 0.03)
    x, _, z = mesh.V.T
    shoulder = np.array([2.5, 1.5, 4.5])
    groups = [(own, (0, 0, 0), mesh.V[own].mean(axis=0)) for own in map(np.flatnonzero, (z < 2, z > 6))]
    hand = np.flatnonzero(x > 7)
    raised = Rotation.from_rotvec([0, -165, 0], degrees=True).apply(mesh.V[hand].mean(axis=0) - shoulder)
    return posed("arm", mesh, [*groups, (hand, (0, -165, 0), raised + shoulder)], points)


def rope_wound(points: int | None) -> DeformationTask:
    """Once around a post."""
    mesh, groups = tube(12, 80, length=24.0), []
    for share in (0.0, 1 / 3, 2 / 3, 1.0):
        own = np.flatnonzero(np.abs(mesh.V[:, 2] - (0.75 + 22.5 * share)) < 0.76)
        turn, radius = 2 * np.pi * share, 24 / (2 * np.pi)
        place = np.array([radius * (1 - np.cos(turn)), 4.5 * share, radius * np.sin(turn)])
        groups.append((own, (0, np.degrees(turn), 0), place))
    return posed("rope", mesh, groups, points)


def bent_back(points: int | None) -> DeformationTask:
    """A tube into a U, and a little more."""
    mesh = tube(16, 40, length=12.0)
    z = mesh.V[:, 2]
    low, end = np.flatnonzero(z < 1.5), np.flatnonzero(z > 10.5)
    groups = [(low, (0, 0, 0), mesh.V[low].mean(axis=0)), (end, (0, 190, 0), np.array([7.0, 0, 1.5]))]
    return posed("U", mesh, groups, points)


def in_steps(task: DeformationTask, solve: partial, *, steps: int = 4) -> np.ndarray:
    """Positions after handles were taken along the rigid motions of their groups."""
    handles, V = task.handles, task.mesh.V
    source = V[handles.index]
    for share in np.arange(1, steps + 1) / steps:
        target = np.empty_like(source)
        for group in np.unique(handles.group):
            own = handles.group == group
            R, t = rigid_motion(source[own], handles.target[own])
            c = source[own].mean(axis=0)
            turn = Rotation.from_rotvec(share * Rotation.from_matrix(R).as_rotvec())
            target[own] = turn.apply(source[own] - c) + c + share * (R @ c + t - c)
        step = DeformationTask(
            "step", task.mesh, Handles(handles.index, target, group=handles.group), guess=V
        )
        V = solve(step, max_iterations=20).vertices
    return V


@pytest.mark.parametrize("points", [None, 15])
@pytest.mark.parametrize("pose", [head_turned, arm_raised, rope_wound, bent_back])
def test_the_minimum_is_one_of_the_lowest(pose, points):
    task = pose(points)
    options = resolve("fast", {"vertices": task.mesh.n, "max_iterations": ITERATIONS})
    solve = partial(local_global, **options.subset(SOLVER))
    starts = {"rest": partial(solve, start="rest"), "rigid": solve}
    found = {name: start(task).extra["energy"] for name, start in starts.items()}
    guesses = {"steps": in_steps(task, solve)}
    guide = {"attachment": options.guide_attachment, "stiffness": 1.0, "area": 1.0}
    guesses["guide"] = solve(task, **guide).vertices
    found |= {name: solve(replace(task, guess=V)).extra["energy"] for name, V in guesses.items()}
    ours = solve_proxy(task, options).extra["energy"]
    assert ours < 1.05 * min(found.values()), found

"""Scenes in Python, whose results, calls and memory are recorded. Each yields names and values."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from baselines.accelerated import local_global
from baselines.arap import arap, elastic
from baselines.arap_sr.arap_sr import arap_sr
from baselines.deformation_graph.deformation_graph import deformation_graph
from defaust.tasks.hairpin import hairpin_task
from eval.metrics import measure
from sshade import (
    DeformationTask,
    Deformer,
    Handles,
    Mesh,
    TransferTask,
    bind,
    deform,
    deform_sequence,
    load_binding,
    move_along,
    save_binding,
)
from sshade.edit.commands import Commands
from sshade.method.transfer import transfer
from tests.shapes import bent, beside, bumpy, end_handles, moved_parts, rotation, shifted, strip, tube
from tests.sshade.edit.lent import unpacked
from tests.sshade.edit.sessions import begun, ends
from tests.sshade.mesh.test_cutting import moebius, t_fin

#: What a scene yields: names and values.
Values = Iterator[tuple[str, Any]]
BODY = bumpy(4)
LIMB = tube(30, 80, length=7.0)
SCENES: dict[str, Callable[[], Values]] = {}


def scene(function: Callable[[], Values]) -> Callable[[], Values]:
    SCENES[function.__name__] = function
    return function


def patches(mesh: Mesh = BODY, count: int = 12, turn: float = 0.5, **more: Any) -> DeformationTask:
    """The ends of a mesh along z: one stays, the other turns and moves."""
    order = np.argsort(mesh.V[:, 2])
    R = np.array([[1, 0, 0], [0, np.cos(turn), -np.sin(turn)], [0, np.sin(turn), np.cos(turn)]])
    centre = mesh.V[order[-count:]].mean(axis=0)
    moved = lambda V: centre + (V - centre) @ R.T + [0.2, 0.1, 0.1]  # noqa: E731
    own = moved_parts(mesh.V, (order[:count], 0), (order[-count:], moved), **more)
    return DeformationTask("t", mesh, replace(own, dynamic=own.group > 0))


def solved(task: DeformationTask, **options: Any) -> Values:
    seen: list[str] = []
    report = lambda stage, *_: seen.append(stage) if stage not in seen else None  # noqa: E731
    result = deform(task, progress=report, **options)
    yield from {"result": result, "progress": seen}.items()


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
def drag() -> Values:
    for name, task in {"points": patches(count=8), "regions": patches(count=400)}.items():
        own, rest = task.handles, task.mesh.V[task.handles.index]
        bound = Deformer(task.mesh, own.index, group=own.group, vertices=300)
        for share in (0.2, 0.4, 0.5):
            yield f"{name} {share}", bound.step(rest + share * (own.target - rest), tolerance=1e-4)
        yield f"{name} settled", bound.settle()
        if name == "points":
            bound.rebind(own.index[::3], group=own.group[::3])
            yield f"{name} rebound", bound.step(own.target[::3])
        bound.reset()
        yield f"{name} reset", bound.solve(own.target[:: 3 if name == "points" else 1])


@scene
def drag_of_fine_and_paper() -> Values:
    task = patches(LIMB, 30)
    own, rest = task.handles, task.mesh.V[task.handles.index]
    for method, more in {"fine": {}, "paper": {"samplings": 2}}.items():
        bound = Deformer(task.mesh, own.index, group=own.group, method=method, vertices=200, **more)
        for share in (0.3, 0.6):
            yield f"{method} {share}", bound.step(rest + share * (own.target - rest))
        yield f"{method} settled", bound.settle()


@scene
def sequence() -> Values:
    task = patches(count=8)
    rest, target = task.mesh.V[task.handles.index], task.handles.target
    poses = [rest + share * (target - rest) for share in (0.2, 0.4, 3.0, 0.5)]
    for number, result in enumerate(deform_sequence(task, poses, vertices=300)):
        yield f"pose {number}", result


@scene
def transfers() -> Values:
    edited = BODY.V * [1, 1.2, 1]
    for more in ({"samplings": 3}, {"samplings": 1, "frames": "blended", "residual": True}):
        task = TransferTask("t", Mesh(edited, BODY.F), BODY, bent(BODY.V))
        yield "transferred", transfer(task, vertices=150, seed=2, **more)


@scene
def binding() -> Values:
    for frames in ("triangle", "blended"):
        bound = bind(BODY, 200, seed=1, frames=frames)
        yield frames, [bound.sampling, bound.proxy, bound.carry(bent(bound.proxy.V))]
        save_binding("bound.npz", bound)
        yield "loaded", load_binding("bound.npz", BODY).carry(bent(bound.proxy.V))
    yield "along", move_along(BODY, bent(BODY.V), 1.03 * BODY.V[:200])


@scene
def memory() -> Values:
    """A mesh that is large beside its proxy."""
    yield from solved(patches(bumpy(6), 40), vertices=100, max_iterations=3)


@scene
def memory_of_fine() -> Values:
    yield from solved(
        patches(bumpy(5), 40), vertices=100, method="fine", max_iterations=3, polish_iterations=3
    )


@scene
def measures() -> Values:
    mesh = bumpy(3)
    own = end_handles(mesh.V, count=6, shift=[0.2, 0, 0])
    V = bent(mesh.V, 0.4)
    V[5] += 1.5
    yield "of a body", measure(DeformationTask("t", mesh, own, truth=bent(mesh.V)), V)
    sheet = strip(12, 4)
    flat = DeformationTask("t", sheet, end_handles(sheet.V, axis=0))
    yield "of a sheet", measure(flat, bent(sheet.V))


@scene
def baselines() -> Values:
    task = patches(bumpy(3), 8)
    for name, method in {
        "arap": partial(arap, max_iterations=6),
        "elastic": partial(elastic, max_iterations=6),
        "accelerated": partial(local_global, max_iterations=30),
        "arap_sr": partial(arap_sr, max_iterations=6),
        "deformation_graph": deformation_graph,
    }.items():
        yield name, method(task, seed=0)
    yield "hairpin", deform(hairpin_task(gap=0.05, angle=20.0, around=20), vertices=200)


@scene
def editor() -> Values:
    with mock.patch("sshade.edit.session.Thread"):  # which binds while the user looks for a place to drag
        yield from edits()


def edits() -> Values:
    session = begun(bumpy(3))
    commands = Commands(session)
    low, high = ends(session.mesh.V)

    def said(command: str, /, **given: Any) -> tuple[str, Any]:
        return command, unpacked(commands(command, given))

    yield "whole", unpacked(commands.whole())
    yield "select", unpacked(commands.select(low, "replace"))
    yield said("mark", kind="fixed")
    yield "select", unpacked(commands.select(high, "replace"))
    yield said("mark", kind="moved")
    move = {"group": 2, "pivot": [0, 0, 0.3], "move": [0.1, 0, 0.05], "quaternion": [0.1, 0, 0, 1]}
    yield said("drag", **move)
    yield said("release", **move)
    yield said("settle")
    yield said("alter", group=2, weight=3.0, name="tip")
    yield said("settle")
    yield said("limit", group=2, distance=1.0)
    yield said("pick", group=1)
    yield said("undo")
    yield said("redo")
    yield said("set_up", method="paper", joints=0.5)
    yield said("restore", group=2)
    yield said("release", **move)
    yield said("save", what="handles", name="groups.json", over=True)
    yield said("save", what="mesh", name="shape.ply", over=True)
    yield said("remove", group=3)
    yield "command", session.document.command
    yield "saved", Path("groups.json").read_text()
    session.end(5)

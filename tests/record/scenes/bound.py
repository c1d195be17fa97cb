"""Bound meshes: drags, sequences, transfers, and bindings that are saved."""

from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np

from sshade import (
    DeformationTask,
    Deformer,
    Mesh,
    TransferTask,
    bind,
    deform_sequence,
    load_binding,
    move_along,
    save_binding,
    transfer_pose,
)
from sshade.method.transfer import transfer
from tests.record.scenes.scene import BODY, LIMB, Values, outcomes, patches, scene, solved
from tests.shapes import bent, beside, bumpy, moved_parts, rotation, shifted, torn
from tests.sshade.mesh.test_cutting import moebius, t_fin


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


#: Tasks and options of drags.
SMALL = bumpy(3)
REGIONS = patches(SMALL, count=200)
DRAGGED = {
    "soft": (patches(SMALL, weights=[np.inf, 3.0]), {}),
    "turned": (patches(SMALL, 1, rotations=[None, rotation(4)]), {"joints": 0}),
    "regions": (REGIONS, {"volume_goal": 1.1}),
    "samplings": (patches(SMALL, count=8), {"method": "paper", "samplings": 2}),
    "published": (patches(SMALL, count=8), {"method": "paper", "accelerate": False}),
    "fine": (REGIONS, {"method": "fine", "polish_iterations": 5}),
    "two": (patches(beside(SMALL, shifted(SMALL, [4, 0, 0]), shifted(bumpy(2), [0, 4, 0])), count=8), {}),
    "fin": (patches(t_fin(6), count=8), {}),
    "band": (patches(moebius(40), count=8), {}),
}


@outcomes
def drags() -> Values:
    """Drags of all kinds: into an array, without an iteration, back, settled and solved."""
    for name, (task, options) in DRAGGED.items():
        own, rest = task.handles, task.mesh.V[task.handles.index]
        bound = Deformer(task.mesh, own.index, group=own.group, weight=own.weight, vertices=150, **options)
        out = np.empty_like(task.mesh.V)
        for share in (0.2, 0.4, 0.6):
            target = rest + share * (own.target - rest)
            yield name, bound.step(target, tolerance=1e-4, max_iterations=4, out=out).vertices
        yield f"{name} turned", bound.step(target, rotations=own.rotation).vertices
        yield f"{name} at once", bound.step(own.target, max_iterations=0).vertices
        yield f"{name} to the end", bound.step(own.target, tolerance=0, max_iterations=9).iterations
        yield f"{name} settled", bound.settle(out=out)
        yield f"{name} array", out
        yield f"{name} judged", str(bound.quality(out))
        yield f"{name} solved", bound.solve(rest, guess=out).vertices
        yield f"{name} settled again", bound.settle().vertices
        yield f"{name} solved again", bound.solve(own).facts
        yield f"{name} judged again", str(bound.quality(out))
        with mock.patch("sshade.method.bound.quality", lambda mesh, V, proxies, **_: len(proxies)):
            yield f"{name} proxies judged", bound.quality(out)


@outcomes
def rebinds() -> Values:
    """Other handles of a bound mesh: soft ones, one that is no sample, regions before points, and copies."""
    many, few = REGIONS.handles, patches(SMALL, count=5).handles
    soft = replace(few, weight=np.where(few.dynamic, 20.0, np.inf))
    one = moved_parts(SMALL.V, (few.index[:5], 0), ([411], [0.4, 0, -0.3]))
    for name, first, *others in (("ends", patches(SMALL).handles, soft, one), ("regions", many, few)):
        bound = Deformer(SMALL, first.index, group=first.group, vertices=400, coarser=1)
        bound.step(first.target)
        for number, own in enumerate(others):
            bound.rebind(own.index, group=own.group, weight=own.weight)
            turns = np.where((own.group > 0)[:, None, None], rotation(1), np.nan)
            steps = [bound.step(own.target, max_iterations=3).vertices for _ in range(3)]
            yield f"{name} {number}", [*steps, bound.step(own.target, rotations=turns).vertices]
            yield f"{name} {number} settled", bound.settle().vertices
            yield f"{name} {number} solved", bound.solve(own.target).vertices
    V, F, seam = torn(SMALL)
    copies = np.concatenate([1 + few.index, seam[:2], SMALL.n + 1 + np.arange(2)])
    bound = Deformer(V, F, copies, vertices=150)
    turns = np.concatenate([np.full((10, 3, 3), np.nan), [rotation(1)] * 4])
    yield "copies", [bound.step(V[copies], rotations=turns).vertices, bound.settle().vertices]
    yield "copies solved", bound.solve(V[copies], rotations=turns).vertices


@scene
def sequence() -> Values:
    yield from posed(patches(count=8))
    yield from posed(patches(SMALL, 8), vertices=12_000)  # more than the mesh has


def posed(task: DeformationTask, vertices: int = 300, **options: Any) -> Values:
    rest, target = task.mesh.V[task.handles.index], task.handles.target
    poses = [rest + share * (target - rest) for share in (0.2, 0.4, 3.0, 0.5)]
    for number, result in enumerate(deform_sequence(task, poses, vertices=vertices, **options)):
        yield f"pose {number}", result


@outcomes
def sequences() -> Values:
    yield from posed(patches(SMALL, 4, rotations=[None, rotation(4)], weights=[np.inf, 5.0]))
    yield from posed(patches(beside(SMALL, shifted(SMALL, [4, 0, 0])), count=8))
    yield from posed(REGIONS, method="fine", polish_iterations=3)


@scene
def memory_of_samplings() -> Values:
    mesh = bumpy(6)
    more: dict[str, Any] = {"vertices": 100, "samplings": 6, "workers": 1}
    yield "transfer", transfer_pose(mesh, bent(mesh.V), **more).vertices
    yield from solved(patches(mesh, 40), method="paper", max_iterations=3, **more)


@scene
def memory_of_a_drag() -> Values:
    """Steps into an array, of a mesh that is large beside its proxy, and clothes of many vertices."""
    task = patches(bumpy(5), 8)
    bound, out = Deformer(task.mesh, task.handles.index, vertices=60), np.empty_like(task.mesh.V)
    for _ in range(3):
        yield "step", bound.step(task.handles.target, out=out).vertices
    yield "along", move_along(SMALL, bent(SMALL.V), np.tile(1.03 * SMALL.V, (20, 1)))


@scene
def transfers() -> Values:
    edited = BODY.V * [1, 1.2, 1]
    for more in (
        {"samplings": 3},
        {"samplings": 1, "frames": "blended", "residual": True},
        {"samplings": 1, "coarser": 60},
    ):
        task, reports = TransferTask("t", Mesh(edited, BODY.F), BODY, bent(BODY.V)), []
        report = lambda *words: reports.append(str(words))  # noqa: E731, B023
        yield "transferred", transfer(task, vertices=150, seed=2, progress=report, **more)
        yield "reports", sorted(reports)


@scene
def binding() -> Values:
    for frames in ("triangle", "blended"):
        bound = bind(BODY, 200, seed=1, frames=frames)
        yield frames, [bound.sampling, bound.proxy, bound.carry(bent(bound.proxy.V))]
        save_binding("bound.npz", bound)
        yield "loaded", load_binding("bound.npz", BODY).carry(bent(bound.proxy.V))
    yield "along", move_along(BODY, bent(BODY.V), 1.03 * BODY.V[:200])

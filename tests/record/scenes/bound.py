"""Bound meshes: drags, sequences, transfers, and bindings that are saved."""

from sshade import (
    Deformer,
    Mesh,
    TransferTask,
    bind,
    deform_sequence,
    load_binding,
    move_along,
    save_binding,
)
from sshade.method.transfer import transfer
from tests.record.scenes.scene import BODY, LIMB, Values, patches, scene
from tests.shapes import bent


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

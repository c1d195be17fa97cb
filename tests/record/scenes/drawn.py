"""Figures in notebooks, pictures, and the shapes of the Blender extension."""

from dataclasses import replace
from unittest import mock

import numpy as np
import pyvista
import trimesh

from sshade import DeformationResult, DeformationTask, Handles, Mesh, TransferTask, plot
from sshade.blender.rig import STILL, Rig, RigGroup, rigid
from sshade.files.arrays import Arrays
from sshade.plotting import pictures, view
from sshade.plotting.pictures import View
from sshade.plotting.view import ViewShape, packed_view, surface
from tests.record.described import figure_facts
from tests.record.scenes.scene import Values, outcomes
from tests.shapes import bent, beside, bumpy, end_handles, shifted


@outcomes
def figures() -> Values:
    rest = bumpy(2)
    V, F = np.array(rest.V), np.array(rest.F)
    handles = end_handles(V, count=5, shift=(0.3, 0, 0.2))
    task = DeformationTask("bend", rest, handles)
    result, few = DeformationResult(V * [1, 1, 1.2], 0, None), Handles(handles.index[:3], handles.target[:3])
    other, transfer = Mesh(1.5 * V, F), TransferTask("t", rest, Mesh(1.5 * V, F), 2 * V, truth=3 * V)
    loose = np.vstack([[9.0, 9, 9], V])
    unused = trimesh.Trimesh(loose, F + 1, process=False)
    shapes: dict[str, tuple] = {
        "task": (task,),
        "truth": (replace(task, truth=bent(V)),),
        "mesh and handles": (rest, few),
        "result": (result.of(task),),
        "results": (result.of(task), result.of(task)),
        "other handles": (task, few),
        "arrays": (V, F, 2 * V, other),
        "lists": (Arrays(V, F), result, (2 * V).tolist()),
        "of a transfer": (result.of(transfer),),
        "transfer": (transfer,),
        "unused": (unused, Handles(handles.index + 1, handles.target), 2 * loose),
        "of pyvista": (pyvista.PolyData.from_regular_faces(V, F), rest),
    }
    for name, given in shapes.items():
        figure = plot(*given)
        yield name, {"repr": repr(figure), **figure_facts(figure.page)}
    looks = {"names": ["</script><b>"]}, {"values": V[:, 2], "label": "z (m)", "up": "z"}
    looks += {"values": np.full(rest.n, -1e30)}, {"up": "z"}
    for look in looks:
        yield str(sorted(look)), figure_facts(plot(rest, result, **look).page)


@outcomes
def reduced() -> Values:
    """What a view shows of large meshes, and their pictures."""
    mesh = bumpy(3)
    handles = Handles(np.arange(50), mesh.V[:50] + [0, 0, 1], dynamic=np.arange(50) > 25)
    shapes = [ViewShape("rest", "", mesh.V), ViewShape("bent", "so", bent(mesh.V), mesh.V[:, 2])]
    colours = np.arange(3 * mesh.n, dtype=np.uint8).reshape(-1, 3)
    with mock.patch.object(pictures, "HANDLES", 20):
        for size in ((600, 150), (642, 150)):
            facts = packed_view(mesh, shapes, handles=handles, bottom=-1.0, size=size, colours=colours)
            yield str(size), facts
    two = beside(mesh, shifted(bumpy(2), [9, 0, 0]))
    for parts in (200, 1):
        with mock.patch.object(view, "PARTS", parts):
            few = surface(two, keep=np.array([5, 700]), limit=600, samples=200)
            yield f"{parts} parts", {**few._asdict(), "mean": few.mean(two.V[:, 0])}
    for look in ({}, {"towards": [1, 0.2, 0], "up": [0, 0, 1]}):
        seen = View.of([mesh.V, bent(mesh.V)], **look)
        yield "view", [seen, seen.with_foot(0.2), seen.pixels(300)]
    for colour in (None, "stretch", "distance"):
        plotter = pictures.draw(mesh, handles, [bent(mesh.V), 1.1 * mesh.V], colour=colour)
        yield "size", plotter.window_size
        for renderer in plotter.renderers:
            for actor in renderer.actors.values():
                if mapper := getattr(actor, "mapper", None):
                    yield "points", np.array(mapper.dataset.points)
                    yield "colours", [mapper.scalar_range, np.array(mapper.dataset.active_scalars, float)]
            camera = renderer.camera
            yield "camera", [camera.position, camera.focal_point, camera.up, camera.parallel_scale]
        plotter.close()


@outcomes
def rig() -> Values:
    """A body and a copy that follows it, with a vertex group of each kind and a vertex without a face."""
    body = bumpy(3)
    V = np.vstack([body.V, body.V + [5, 0, 0], [[9, 9, 9]]]).astype(np.float32)
    F = np.vstack([body.F, body.F + body.n])
    z = np.where(np.arange(len(V)) < body.n, V[:, 2], 0)
    side = (V[:, 1] > 1.2) & (np.abs(z) < 1.4)
    weights = 1 * (z < -1.5), np.where(z > 1.8, 1, 0.6 * (z > 1.5)), 0.3 * side
    kinds = zip(("low", "high", "side"), weights, (False, True, True), strict=True)
    own = Rig(V, F, [RigGroup(name, np.float32(weight), moves) for name, weight, moves in kinds])
    turn = np.array([[0.8, -0.6, 0, 0.1], [0.6, 0.8, 0, 0], [0, 0, 1, 0.4], [0, 0, 0, 1]])
    motions = [STILL, rigid(turn), rigid(np.eye(4) + 0.2 * np.eye(4, k=3))]
    yield "handles", {"rest": own.handles.target, "moved": own.moved(motions).target}
    yield "weights", own.handles.weight
    yield "centroids", [own.centroid(number) for number in range(3)]
    for options in ({}, {"joints": 0.0}, {"method": "fine", "joints": 2.0}):
        yield "deformed", own.deform(motions, **options)
    bound = own.bound()
    for part in (motions, motions, [STILL] * 3):
        yield "step", own.step(bound, part)
    yield "deformed again", own.deform(motions)
    yield "rest", [own.V, own.handles.target]

"""Scenes that Blender runs without its window: ``python -m tests.sshade.blender.scenes ZIP REPORT.json``.

The extension is installed first. The report has the facts of each scene, or the traceback of its failure.
"""

import hashlib
import json
import sys
import traceback
from math import inf
from pathlib import Path

import bpy
import numpy as np

import sshade
from docs import blender_task
from sshade import DeformationTask, Handles, Mesh
from tests.shapes import bumpy

MOVE, TURN = (0.1, 0.0, 0.3), (0.0, 0.2, 0.1)


def fresh():
    """Return a new object with contents of all kinds, its positions (n, 3) float32 and triangles (m, 3)."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=False)
    mesh = bpy.data.meshes.new("Body")
    shape = bumpy(3)
    V, F = shape.V.astype(np.float32), shape.F
    mesh.from_pydata(V.tolist(), [], F.tolist())
    obj = bpy.data.objects.new("Body", mesh)
    bpy.context.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    uv = mesh.uv_layers.new(name="UV")
    uv.uv.foreach_set("vector", np.random.default_rng(0).random(2 * len(mesh.loops)).astype(np.float32))
    colour = mesh.color_attributes.new("Colour", "BYTE_COLOR", "CORNER")
    colour.data.foreach_set("color", np.random.default_rng(1).random(4 * len(mesh.loops)).astype(np.float32))
    mesh.materials.append(bpy.data.materials.new("Skin"))
    mesh.normals_split_custom_set([(0.0, 0.6, 0.8)] * len(mesh.loops))
    obj.modifiers.new("Mirror", "MIRROR")
    return obj, V, F


def with_handles(obj, V, *, weight=1.0):
    """Add a fixed group at the bottom and a moving group of a weight at the top; return their vertices."""
    low, high = V[:, 2].min(), V[:, 2].max()
    fixed = np.flatnonzero(V[:, 2] < low + 0.2 * (high - low))
    moving = np.flatnonzero(V[:, 2] > high - 0.2 * (high - low))
    for name, own, value in (("fixed", fixed, 1.0), ("moving", moving, weight)):
        obj.vertex_groups.new(name=name).add(own.tolist(), value, "REPLACE")
        bpy.ops.sshade.handle_add()
    bpy.ops.sshade.empty_add()
    moved = obj.sshade.handles["moving"].empty
    moved.location = np.array(moved.location) + MOVE
    moved.rotation_euler = TURN
    return fixed, moving


def expected(obj, V, F, fixed, moving, *, method="fast", weight=inf):
    """Return the package's own result (n, 3) float32 for the place of the empty, from first principles."""
    bpy.context.view_layer.update()
    mesh, handle = Mesh(V.astype(np.float64), F), obj.sshade.handles["moving"]
    index = np.concatenate([fixed, moving])
    target = mesh.V[index].copy()
    own = np.arange(len(index)) >= len(fixed)
    matrix = obj.matrix_world.inverted() @ handle.empty.matrix_world @ handle.rest
    matrix = np.array(matrix, dtype=np.float64)  # it has float32 otherwise
    U, _, Vt = np.linalg.svd(matrix[:3, :3])
    target[own] = target[own] @ (U @ Vt).T + matrix[:3, 3]
    weights = np.where(own, weight, inf)
    handles = Handles(index, target, dynamic=own, group=own.astype(int), weight=weights)
    task = DeformationTask("oracle", mesh, handles)
    return sshade.deform(task, method=method).vertices.astype(np.float32)


def points(key):
    U = np.empty((len(key.points), 3), dtype=np.float32)
    key.points.foreach_get("co", U.ravel())
    return U


def rest(obj):
    U = np.empty((len(obj.data.vertices), 3), dtype=np.float32)
    obj.data.attributes["position"].data.foreach_get("vector", U.ravel())
    return U


def contents(obj):
    """Return a digest of everything that a deformation must keep."""
    mesh, digest = obj.data, hashlib.sha256()
    for name, key in (("UV", "vector"), ("Colour", "color"), ("custom_normal", "value")):
        values = [getattr(one, key) for one in mesh.attributes[name].data]
        digest.update(str([tuple(value) for value in values]).encode())
    groups = [[(g.group, g.weight) for g in vertex.groups] for vertex in mesh.vertices]
    names = [mesh.materials.keys(), obj.modifiers.keys(), obj.vertex_groups.keys(), mesh.has_custom_normals]
    digest.update(f"{groups} {names}".encode())
    return digest.hexdigest()


def refused(call, *arguments):
    """Return the message of an operator's error."""
    try:
        call(*arguments)
    except RuntimeError as error:
        return str(error).strip().removeprefix("Error: ")
    return ""


def scene_operator():
    """Deform by both methods as new shape keys."""
    obj, V, F = fresh()
    fixed, moving = with_handles(obj, V)
    before, facts = contents(obj), {}
    for method in ("fast", "fine"):
        obj.sshade.method = method
        bpy.ops.sshade.deform()
        key = obj.data.shape_keys.key_blocks[-1]
        facts[method] = bool((points(key) == expected(obj, V, F, fixed, moving, method=method)).all())
    facts |= {"keys": obj.data.shape_keys.key_blocks.keys(), "value": key.value}
    facts |= {"moved": float(np.abs(points(key) - V).max()), "rest": bool((rest(obj) == V).all())}
    return {**facts, "kept": contents(obj) == before}


def scene_live():
    """Follow an empty; the finished shape is the operator's."""
    obj, V, F = fresh()
    fixed, moving = with_handles(obj, V)
    empty = obj.sshade.handles["moving"].empty
    end = empty.location.copy()
    before = contents(obj)
    empty.location = end - bpy_vector(MOVE)
    bpy.ops.sshade.live_start()
    key = obj.data.shape_keys.key_blocks[-1]
    off = []
    for part in np.linspace(0, 1, 6)[1:]:
        empty.location = end - bpy_vector(MOVE) * (1 - part)
        bpy.context.view_layer.update()
        matrix = np.array(empty.matrix_world @ obj.sshade.handles["moving"].rest)
        goal = V[moving] @ matrix[:3, :3].T + matrix[:3, 3]
        off.append(float(np.abs(points(key)[moving] - goal).max()))
    goal = expected(obj, V, F, fixed, moving)
    lag = float(np.abs(points(key) - goal).max())
    running = live_module().RUNNING[obj.session_uid]
    for _ in range(40):
        if running.settle() is None:
            break
    settled = float(np.abs(points(key) - goal).max())
    bpy.ops.sshade.live_finish()
    same = bool((points(obj.data.shape_keys.key_blocks[-1]) == goal).all())
    facts = {"off": max(off), "lag": lag, "settled": settled, "finished": same}
    facts |= {"kept": contents(obj) == before, "rest": bool((rest(obj) == V).all())}
    facts["diagonal"] = float(np.linalg.norm(np.ptp(V, axis=0)))
    return facts | {"keys": obj.data.shape_keys.key_blocks.keys()}


def scene_cancel():
    """Cancel the live mode: the object is as before, with its earlier shape key."""
    obj, V, F = fresh()
    with_handles(obj, V)
    before = contents(obj)
    bpy.ops.sshade.deform()
    bpy.ops.sshade.live_start()
    moved = float(np.abs(points(obj.data.shape_keys.key_blocks[-1]) - V).max())
    twice = bpy.ops.sshade.live_start.poll(), bpy.ops.sshade.deform.poll()
    bpy.ops.sshade.live_cancel()
    return {
        "moved": moved,
        "twice": twice,
        "keys": {key.name: key.value for key in obj.data.shape_keys.key_blocks},
        "kept": contents(obj) == before and bool((rest(obj) == V).all()),
        "running": len(live_module().RUNNING),
    }


def scene_scaled_in_live_mode():
    """Scale an empty in the live mode: a message, and the mode goes on when the scale is back."""
    obj, V, F = fresh()
    with_handles(obj, V)
    empty = obj.sshade.handles["moving"].empty
    bpy.ops.sshade.live_start()
    shape, said = points(obj.data.shape_keys.key_blocks[-1]), []
    for scale in (2.0, 1.0):
        empty.scale = (scale, 1.0, 1.0)
        empty.location.x += 0.1
        bpy.context.view_layer.update()
        moved = float(np.abs(points(obj.data.shape_keys.key_blocks[-1]) - shape).max())
        said.append([obj.sshade.message, moved])
    return said


def scene_undo():
    """Undo and redo a deformation, and a motion in the live mode."""
    obj, V, F = fresh()
    with_handles(obj, V)
    bpy.ops.ed.undo_push(message="begin")
    bpy.ops.sshade.deform()
    bpy.ops.ed.undo_push(message="deform")
    facts = {"done": len(bpy.data.objects["Body"].data.shape_keys.key_blocks)}
    bpy.ops.ed.undo()
    obj = bpy.data.objects["Body"]
    facts["undone"] = obj.data.shape_keys is None
    bpy.ops.ed.redo()
    obj = bpy.data.objects["Body"]
    facts["redone"] = len(obj.data.shape_keys.key_blocks)
    bpy.ops.sshade.live_start()
    bpy.ops.ed.undo_push(message="live")
    at_start = points(obj.data.shape_keys.key_blocks[-1])
    obj.sshade.handles["moving"].empty.location.x += 0.3
    bpy.context.view_layer.update()
    moved = points(obj.data.shape_keys.key_blocks[-1])
    bpy.ops.ed.undo_push(message="move")
    bpy.ops.ed.undo()
    obj = bpy.data.objects["Body"]
    facts["moved"] = float(np.abs(moved - at_start).max())
    facts["restored"] = float(np.abs(points(obj.data.shape_keys.key_blocks[-1]) - at_start).max())
    obj.sshade.handles["moving"].empty.location.x += 0.3
    bpy.context.view_layer.update()
    facts["again"] = float(np.abs(points(obj.data.shape_keys.key_blocks[-1]) - moved).max())
    facts["finished"] = list(bpy.ops.sshade.live_finish())
    return facts


def scene_edited():
    """Edit a mesh between bind and step: the live mode ends, and nothing is lost."""
    facts = {}
    for edit in ("moved", "group", "key"):
        obj, V, F = fresh()
        with_handles(obj, V)
        bpy.ops.sshade.live_start()
        shape = points(obj.data.shape_keys.key_blocks[-1])
        if edit == "moved":
            obj.data.shape_keys.reference_key.points[0].co.x += 1
        elif edit == "group":
            obj.sshade.handles.remove(0)
        else:
            obj.shape_key_remove(obj.data.shape_keys.key_blocks[-1])
        obj.sshade.handles["moving"].empty.location.x += 0.1
        bpy.context.view_layer.update()
        keys = obj.data.shape_keys.key_blocks
        stays = edit == "key" or bool((points(keys[-1])[: len(V)] == shape).all())
        message = obj.sshade.message
        facts[edit] = [message, stays, refused(bpy.ops.sshade.live_start)]
    return facts


def scene_refusals():
    """Return the message of each mistake, and whether the object is unchanged."""
    mistakes = {
        "scaled": lambda obj: setattr(obj.sshade.handles["moving"].empty, "scale", (1, 2, 1)),
        "unequal": lambda obj: setattr(obj, "scale", (1, 2, 1)),
        "no group": lambda obj: obj.vertex_groups.remove(obj.vertex_groups["moving"]),
        "deleted": lambda obj: bpy.context.collection.objects.unlink(obj.sshade.handles["moving"].empty),
        "no handles": lambda obj: obj.sshade.handles.clear(),
        "twice": lambda obj: setattr(obj.sshade.handles[0], "name", "moving"),
    }
    facts = {}
    for name, mistake in mistakes.items():
        obj, V, F = fresh()
        with_handles(obj, V)
        mistake(obj)
        before, there = contents(obj), rest(obj)
        messages = [refused(operator) for operator in (bpy.ops.sshade.deform, bpy.ops.sshade.live_start)]
        same = contents(obj) == before and np.array_equal(rest(obj), there)
        facts[name] = [*messages, same and obj.data.shape_keys is None and not live_module().RUNNING]
    obj, V, F = fresh()
    facts["no vertex group"] = [refused(bpy.ops.sshade.handle_add)]
    with_handles(obj, V)
    facts["added twice"] = [refused(bpy.ops.sshade.handle_add)]
    return facts


def scene_page():
    """Run the script of the page, and read its file."""
    bpy.ops.wm.read_homefile(use_empty=True)
    path = str(Path(sys.argv[2]).with_name("tube.blend"))
    blender_task.main(path)
    bpy.ops.wm.open_mainfile(filepath=path)
    obj = bpy.data.objects["Tube"]
    U = points(obj.data.shape_keys.key_blocks["SShaDe"])
    return {
        "top": U[rest(obj)[:, 2] > 7.5].mean(axis=0).tolist(),
        "foot": float(np.abs(U - rest(obj))[:40].max()),
    }


def bpy_vector(values):
    from mathutils import Vector

    return Vector(values)


def live_module():
    from bl_ext.user_default.sshade import live

    return live


def main(extension, report):
    """Install the extension, run all scenes, and write the report."""
    installed = bpy.ops.extensions.package_install_files(
        repo="user_default", filepath=extension, enable_on_install=True
    )
    import sshade_probe  # the wheel in the extension

    facts = {"installed": [*installed, sshade_probe.__file__]}
    for name, scene in list(globals().items()):
        if name.startswith("scene_"):
            try:
                facts[name.removeprefix("scene_")] = scene()
            except Exception:
                facts[name.removeprefix("scene_")] = traceback.format_exc()
    bpy.ops.preferences.addon_disable(module="bl_ext.user_default.sshade")
    facts["disabled"] = not hasattr(bpy.types.Object, "sshade")
    Path(report).write_text(json.dumps(facts, default=float))


if __name__ == "__main__":
    main(*sys.argv[1:])

"""Scenes that Blender runs without its window: ``python -m tests.sshade.blender.scenes ZIP REPORT.json``.

The extension is installed first. The report has the traceback of each scene that failed, "" for the others.
"""

import hashlib
import json
import sys
import traceback
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

import sshade
from docs import blender_task
from sshade import DeformationTask, Handles, Mesh
from tests.shapes import bumpy

SCALED = (
    "empty 'moving' was scaled, or the object's scale was applied; set the scale back, or clear the empty "
    "and choose it again"
)
UNEQUAL = "object 'Body' has scales that are unequal or zero; apply its scale (Ctrl A, Scale)"
WITHOUT = "group 'moving' is moved, but has no empty in a scene; choose or add one"
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


def with_handles(obj, V):
    """Add a fixed group at the bottom and a moving group at the top; return their vertices."""
    low, high = V[:, 2].min(), V[:, 2].max()
    fixed = np.flatnonzero(V[:, 2] < low + 0.2 * (high - low))
    moving = np.flatnonzero(V[:, 2] > high - 0.2 * (high - low))
    for name, own in (("fixed", fixed), ("moving", moving)):
        obj.vertex_groups.new(name=name).add(own.tolist(), 1.0, "REPLACE")
        bpy.ops.sshade.handle_add()
    bpy.ops.sshade.empty_add()
    moved = obj.sshade.handles["moving"].empty
    moved.location = np.array(moved.location) + MOVE
    moved.rotation_euler = TURN
    return fixed, moving


def expected(obj, V, F, fixed, moving, **options):
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
    handles = Handles(index, target, dynamic=own, group=own.astype(int))
    task = DeformationTask("oracle", mesh, handles)
    return sshade.deform(task, **options).vertices.astype(np.float32)


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


def refused(call):
    """Return the message of an operator's error."""
    try:
        call()
    except RuntimeError as error:
        return str(error).strip().removeprefix("Error: ")
    return ""


def shown(obj):
    """Return the positions (n, 3) of the last shape key."""
    return points(obj.data.shape_keys.key_blocks[-1])


def move(obj, x):
    """Move the empty by x and update the scene."""
    obj.sshade.handles["moving"].empty.location.x += x
    bpy.context.view_layer.update()


def scene_results_are_those_of_the_package_bit_by_bit_and_all_else_stays():
    obj, V, F = fresh()
    fixed, moving = with_handles(obj, V)
    before = contents(obj)
    for method, joints in ("fast", 0.5), ("fine", 1.0):
        obj.sshade.method, obj.sshade.joints = method, joints
        bpy.ops.sshade.deform()
        assert (shown(obj) == expected(obj, V, F, fixed, moving, method=method, joints=joints)).all()
    keys = obj.data.shape_keys.key_blocks
    assert keys.keys() == ["Basis", "SShaDe", "SShaDe.001"] and [key.value for key in keys[1:]] == [0, 1]
    assert np.abs(shown(obj) - V).max() > 0.3 and (rest(obj) == V).all() and contents(obj) == before


def scene_the_live_mode_follows_and_ends_at_the_result_of_the_operator():
    obj, V, F = fresh()
    fixed, moving = with_handles(obj, V)
    empty = obj.sshade.handles["moving"].empty
    end = empty.location.copy()
    before, diagonal = contents(obj), np.linalg.norm(np.ptp(V, axis=0))
    empty.location = end - Vector(MOVE)
    bpy.ops.sshade.live_start()
    for part in np.linspace(0, 1, 6)[1:]:
        empty.location = end - Vector(MOVE) * (1 - part)
        bpy.context.view_layer.update()
        matrix = np.array(empty.matrix_world @ obj.sshade.handles["moving"].rest)
        goal = V[moving] @ matrix[:3, :3].T + matrix[:3, 3]
        assert np.abs(shown(obj)[moving] - goal).max() < 1e-6 * diagonal
    goal = expected(obj, V, F, fixed, moving)
    lag = np.abs(shown(obj) - goal).max()
    running = live_module().RUNNING[obj.session_uid]
    while running.settle() is not None:
        pass
    assert np.abs(shown(obj) - goal).max() <= lag < 0.02 * diagonal
    bpy.ops.sshade.live_finish()
    assert (shown(obj) == goal).all() and obj.data.shape_keys.key_blocks.keys() == ["Basis", "SShaDe"]
    assert contents(obj) == before and (rest(obj) == V).all()


def scene_a_scaled_empty_pauses_the_live_mode_and_cancel_restores_the_object_and_its_earlier_key():
    obj, V, F = fresh()
    with_handles(obj, V)
    before, empty = contents(obj), obj.sshade.handles["moving"].empty
    bpy.ops.sshade.deform()
    bpy.ops.sshade.live_start()
    shape = shown(obj)
    assert np.abs(shape - V).max() > 0.3
    assert not bpy.ops.sshade.live_start.poll() and not bpy.ops.sshade.deform.poll()
    empty.scale = (2.0, 1.0, 1.0)
    move(obj, 0.1)
    assert obj.sshade.message == SCALED and (shown(obj) == shape).all()
    empty.scale = (1.0, 1.0, 1.0)
    move(obj, 0.1)
    assert obj.sshade.message == "" and np.abs(shown(obj) - shape).max() > 0.1
    bpy.ops.sshade.live_cancel()
    keys = obj.data.shape_keys.key_blocks
    assert {key.name: key.value for key in keys} == {"Basis": 1, "SShaDe": 1}
    assert contents(obj) == before and (rest(obj) == V).all() and not live_module().RUNNING


def scene_a_mistake_is_one_sentence_and_changes_nothing():
    def handle(obj):
        return obj.sshade.handles["moving"]

    mistakes = {
        SCALED: lambda obj: setattr(handle(obj).empty, "scale", (1, 2, 1)),
        UNEQUAL: lambda obj: setattr(obj, "scale", (1, 2, 1)),
        "object 'Body' has no vertex group 'fixed'": lambda obj: obj.vertex_groups.clear(),
        WITHOUT: lambda obj: bpy.context.collection.objects.unlink(handle(obj).empty),
        "there are no groups; add vertex groups in the panel SShaDe": lambda obj: obj.sshade.handles.clear(),
    }
    for said, mistake in mistakes.items():
        obj, V, F = fresh()
        with_handles(obj, V)
        mistake(obj)
        before, there = contents(obj), rest(obj)
        for operator in (bpy.ops.sshade.deform, bpy.ops.sshade.live_start):
            assert refused(operator) == said
        assert contents(obj) == before and np.array_equal(rest(obj), there)
        assert obj.data.shape_keys is None and not live_module().RUNNING
    obj, V, F = fresh()
    assert "has no vertex group" in refused(bpy.ops.sshade.handle_add)
    with_handles(obj, V)
    assert "is in the list already" in refused(bpy.ops.sshade.handle_add)


def scene_the_script_of_the_page_bends_the_tube():
    bpy.ops.wm.read_homefile(use_empty=True)
    path = str(Path(sys.argv[2]).with_name("tube.blend"))
    blender_task.main(path)
    bpy.ops.wm.open_mainfile(filepath=path)
    obj = bpy.data.objects["Tube"]
    U = points(obj.data.shape_keys.key_blocks["SShaDe"])
    top = U[rest(obj)[:, 2] > 7.5].mean(axis=0)
    assert np.abs(top - [3.0, 0, 6.75]).max() < 0.02 and (rest(obj) == U)[:40].all()


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
                scene()
                facts[name] = ""
            except Exception:
                facts[name] = traceback.format_exc()
    bpy.ops.preferences.addon_disable(module="bl_ext.user_default.sshade")
    facts["disabled"] = not hasattr(bpy.types.Object, "sshade")
    Path(report).write_text(json.dumps(facts))


if __name__ == "__main__":
    main(*sys.argv[1:])

# SPDX-License-Identifier: MIT OR GPL-3.0-or-later
"""Operators: deform once, the live mode, and the list of groups."""

from __future__ import annotations

import bpy

from sshade.core.errors import InputError

from . import live
from .data import add_key, read_rig, write_key
from .live import FAILURES


class _OfMesh:
    """Base of all operators: they need a mesh in object mode, and report mistakes in one sentence."""

    bl_options = {"REGISTER", "UNDO"}
    #: Whether the operator needs a live mode; the others refuse one.
    needs_live = False

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        obj = context.object
        found = None
        if obj is None or obj.type != "MESH":
            found = "Select a mesh"
        elif live.edited(obj):
            found = "Switch to Object Mode"
        elif obj.library or obj.data.library:
            found = "The mesh belongs to another file; make it local"
        elif cls.needs_live != (obj.session_uid in live.RUNNING):
            found = "Start the live mode" if cls.needs_live else "End the live mode"
        if found:
            cls.poll_message_set(found)  # type: ignore[attr-defined]
        return not found

    def execute(self, context: bpy.types.Context) -> set[str]:
        context.view_layer.update()  # a script may have moved an empty just now
        context.object.sshade.message = ""
        context.window_manager.progress_begin(0, 1)
        try:
            self.run(context.object)
        except FAILURES as error:
            text = str(error) or "there is not enough memory"
            self.report({"ERROR"}, text)  # type: ignore[attr-defined]
            return {"CANCELLED"}
        finally:
            context.window_manager.progress_end()
        return {"FINISHED"}

    def run(self, obj: bpy.types.Object) -> None:
        raise NotImplementedError


class SSHADE_OT_deform(_OfMesh, bpy.types.Operator):
    """Deform the mesh so that its groups are where their empties say"""

    bl_idname, bl_label = "sshade.deform", "Deform"

    def run(self, obj: bpy.types.Object) -> None:
        V, quality = live.deformed(obj, _show)
        write_key(obj, add_key(obj), V)
        self.report({"INFO"}, quality)  # type: ignore[attr-defined]


def _show(stage: str, done: int, total: int, note: str = "") -> None:
    bpy.context.window_manager.progress_update(done / max(total, 1))


class SSHADE_OT_live_start(_OfMesh, bpy.types.Operator):
    """Bind the mesh, and let a new shape key follow the handles while they move"""

    bl_idname, bl_label = "sshade.live_start", "Start Live Mode"

    def run(self, obj: bpy.types.Object) -> None:
        live.RUNNING[obj.session_uid] = live.Live(obj)


class SSHADE_OT_live_finish(_OfMesh, bpy.types.Operator):
    """Compute the converged shape, and end the live mode"""

    bl_idname, bl_label = "sshade.live_finish", "Finish"
    needs_live = True

    def run(self, obj: bpy.types.Object) -> None:
        running = live.RUNNING[obj.session_uid]
        try:
            running.require_unchanged(obj)
            running.key(obj)
        except InputError:  # the mode cannot go on
            del live.RUNNING[obj.session_uid]
            raise
        self.report({"INFO"}, running.finish(obj))  # type: ignore[attr-defined]
        del live.RUNNING[obj.session_uid]


class SSHADE_OT_live_cancel(_OfMesh, bpy.types.Operator):
    """End the live mode, and remove its shape key"""

    bl_idname, bl_label = "sshade.live_cancel", "Cancel"
    needs_live = True

    def run(self, obj: bpy.types.Object) -> None:
        live.RUNNING.pop(obj.session_uid).cancel(obj)


class SSHADE_OT_handle_add(_OfMesh, bpy.types.Operator):
    """Add the active vertex group to the list"""

    bl_idname, bl_label = "sshade.handle_add", "Add Group"

    def run(self, obj: bpy.types.Object) -> None:
        group = obj.vertex_groups.active
        if group is None:
            raise InputError("the object has no vertex group; assign some vertices to one first")
        if group.name in obj.sshade.handles:
            raise InputError(f"group {group.name!r} is in the list already")
        obj.sshade.handles.add().name = group.name
        obj.sshade.active = len(obj.sshade.handles) - 1


class SSHADE_OT_handle_remove(_OfMesh, bpy.types.Operator):
    """Remove the group from the list; its vertex group stays"""

    bl_idname, bl_label = "sshade.handle_remove", "Remove Group"

    def run(self, obj: bpy.types.Object) -> None:
        obj.sshade.handles.remove(_active(obj))
        obj.sshade.active = max(0, min(obj.sshade.active, len(obj.sshade.handles) - 1))


class SSHADE_OT_empty_add(_OfMesh, bpy.types.Operator):
    """Add an empty at the centre of the group, which moves it. It is a child of the object"""

    bl_idname, bl_label = "sshade.empty_add", "Add Empty"

    def run(self, obj: bpy.types.Object) -> None:
        number = _active(obj)
        handle = obj.sshade.handles[number]
        kind, handle.kind = handle.kind, "MOVED"
        try:
            rig = read_rig(obj)
        except InputError:
            handle.kind = kind
            raise
        empty = bpy.data.objects.new(handle.name, None)
        obj.users_collection[0].objects.link(empty)
        empty.parent, empty.location = obj, rig.centroid(number)
        empty.empty_display_type = "SPHERE"
        empty.empty_display_size = 0.05 * rig.mesh.diagonal
        handle.empty = empty


def _active(obj: bpy.types.Object) -> int:
    """Return the number of the active group."""
    if not 0 <= obj.sshade.active < len(obj.sshade.handles):
        raise InputError("no group is selected in the list")
    return obj.sshade.active


CLASSES = (
    SSHADE_OT_deform,
    SSHADE_OT_live_start,
    SSHADE_OT_live_finish,
    SSHADE_OT_live_cancel,
    SSHADE_OT_handle_add,
    SSHADE_OT_handle_remove,
    SSHADE_OT_empty_add,
)

# SPDX-License-Identifier: MIT OR GPL-3.0-or-later
"""The panel SShaDe in the sidebar of the 3D view."""

import bpy

from . import live


class SSHADE_UL_handles(bpy.types.UIList):
    """The groups of an object."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index) -> None:
        icon = "LOCKED" if item.kind == "FIXED" else "EMPTY_AXIS"
        layout.label(text=item.name or "(no vertex group)", icon=icon)
        layout.prop(item, "kind", text="", emboss=False)


class SSHADE_PT_panel(bpy.types.Panel):
    """Groups and operators."""

    bl_idname, bl_label = "SSHADE_PT_panel", "SShaDe"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "SShaDe"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.object is not None and context.object.type == "MESH"

    def draw(self, context: bpy.types.Context) -> None:
        obj, layout = context.object, self.layout
        settings, is_live = obj.sshade, obj.session_uid in live.RUNNING
        layout.use_property_split = True
        if settings.message:
            layout.label(text=settings.message, icon="ERROR")
        box = layout.column()
        box.enabled = not is_live
        row = box.row()
        row.template_list("SSHADE_UL_handles", "", settings, "handles", settings, "active", rows=3)
        buttons = row.column(align=True)
        buttons.operator("sshade.handle_add", text="", icon="ADD")
        buttons.operator("sshade.handle_remove", text="", icon="REMOVE")
        if 0 <= settings.active < len(settings.handles):
            self._draw_handle(box, obj, settings.handles[settings.active])
        layout.separator()
        layout.prop(settings, "method")
        layout.prop(settings, "joints")
        if is_live:
            row = layout.row(align=True)
            row.operator("sshade.live_finish", icon="CHECKMARK")
            row.operator("sshade.live_cancel", icon="X")
            layout.label(text="Move an empty: the mesh follows", icon="INFO")
        else:
            layout.operator("sshade.deform", icon="MOD_MESHDEFORM")
            layout.operator("sshade.live_start", icon="PLAY")

    @staticmethod
    def _draw_handle(box, obj, handle) -> None:
        """Draw a group."""
        box.prop_search(handle, "name", obj, "vertex_groups", text="Vertex group")
        if handle.kind != "FIXED":
            box.prop(handle, "empty")
            box.operator("sshade.empty_add", icon="EMPTY_AXIS")


CLASSES = (SSHADE_UL_handles, SSHADE_PT_panel)

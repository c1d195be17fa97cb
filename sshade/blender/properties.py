# SPDX-License-Identifier: MIT OR GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Properties of objects: the list of groups, the method and its options."""

import bpy
from bpy.props import (
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from .data import relative

IDENTITY = tuple(tuple(float(row == column) for column in range(4)) for row in range(4))


def _choose_empty(handle: "SSHADE_PG_handle", context: bpy.types.Context) -> None:
    """Make the present place of the empty the place at which the mesh is at rest."""
    if handle.empty is not None:
        bpy.context.view_layer.update()  # a script may have moved the empty just now
        handle.rest = relative(handle.id_data, handle.empty).inverted_safe()


class SSHADE_PG_handle(bpy.types.PropertyGroup):
    """A group of handles. Its name is the name of its vertex group."""

    kind: EnumProperty(
        name="Kind",
        description="How the vertices of the group move",
        items=(
            ("FIXED", "Fixed", "The vertices stay at rest"),
            ("MOVED", "Moved", "The vertices move and turn with an empty"),
        ),
    )
    empty: PointerProperty(
        name="Empty",
        description="Object whose motion from now on moves the vertices",
        type=bpy.types.Object,
        update=_choose_empty,
    )
    rest: FloatVectorProperty(size=(4, 4), subtype="MATRIX", default=IDENTITY, options={"HIDDEN"})


class SSHADE_PG_object(bpy.types.PropertyGroup):
    """Settings of an object."""

    handles: CollectionProperty(type=SSHADE_PG_handle)
    active: IntProperty(name="Active group")
    method: EnumProperty(
        name="Method",
        description="Method of the converged shape",
        items=(
            ("fast", "Fast", "Solve a small proxy of the mesh"),
            ("fine", "Fine", "Polish the result at full resolution, in three to eleven times the time"),
        ),
    )
    joints: FloatProperty(
        name="Joints",
        description="Larger values make joints rounder and thicker; 0 leaves them sharp",
        default=1.0,
        min=0.0,
        soft_max=4.0,
    )
    message: StringProperty(options={"SKIP_SAVE"})


CLASSES = (SSHADE_PG_handle, SSHADE_PG_object)

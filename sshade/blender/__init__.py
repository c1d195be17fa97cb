# SPDX-License-Identifier: MIT OR GPL-3.0-or-later
"""The Blender extension: vertex groups are handles, and the mesh follows them.

``sshade blender`` packs the files of this folder into an extension. Blender loads the files as
``bl_ext.REPOSITORY.sshade`` and finds the package in the wheels of the extension. Only :mod:`.rig` works
without Blender.
"""


def register() -> None:
    """Add properties, operators and the panel to Blender."""
    import bpy

    from . import live, operators, panel, properties

    for one in (*properties.CLASSES, *operators.CLASSES, *panel.CLASSES):
        bpy.utils.register_class(one)
    bpy.types.Object.sshade = bpy.props.PointerProperty(type=properties.SSHADE_PG_object)
    live.register()


def unregister() -> None:
    """End live modes, and remove everything that :func:`register` added."""
    import bpy

    from . import live, operators, panel, properties

    live.unregister()
    del bpy.types.Object.sshade
    for one in reversed((*properties.CLASSES, *operators.CLASSES, *panel.CLASSES)):
        bpy.utils.unregister_class(one)

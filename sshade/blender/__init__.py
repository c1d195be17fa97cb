# SPDX-License-Identifier: MIT OR GPL-3.0-or-later
"""The Blender extension: vertex groups are handles, and the mesh follows them.

``sshade blender`` packs the files of this folder into an extension. Blender loads the files as
``bl_ext.REPOSITORY.sshade`` and finds the package in the wheels of the extension. Only :mod:`.rig` works
without Blender.
"""


def register() -> None:
    """Add properties, operators and the panel to Blender."""
    from . import live, operators, panel, properties

    for module in (properties, operators, panel, live):
        module.register()


def unregister() -> None:
    """End live modes, and remove everything that :func:`register` added."""
    from . import live, operators, panel, properties

    for module in (live, panel, operators, properties):
        module.unregister()

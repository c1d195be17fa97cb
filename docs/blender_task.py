# SPDX-License-Identifier: MIT OR GPL-3.0-or-later
"""Bend a tube in Blender without its window, and save the file: ``python blender_task.py OUT.blend``.

The Python has bpy, or is Blender's: ``blender --background --python blender_task.py -- OUT.blend``. The
extension is installed and enabled.
"""

import sys

import bpy
import numpy as np


def tube(around: int = 40, along: int = 100) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (n, 3) and triangles (m, 3) of an open tube along z, of radius 1 and length 8."""
    angle, height = np.meshgrid(np.arange(around) * 2 * np.pi / around, np.linspace(0, 8, along))
    V = np.stack([np.cos(angle), np.sin(angle), height], axis=-1).reshape(-1, 3).astype(np.float32)
    row, column = np.meshgrid(np.arange(along - 1), np.arange(around), indexing="ij")
    a, b = row * around + column, row * around + (column + 1) % around
    quads = np.stack([a, b, b + around, a, b + around, a + around], axis=-1)
    return V, quads.reshape(-1, 3)


def main(path: str) -> None:
    """Make the scene, deform the tube, and save the file."""
    V, F = tube()
    mesh = bpy.data.meshes.new("Tube")
    mesh.from_pydata(V.tolist(), [], F.tolist())
    obj = bpy.data.objects.new("Tube", mesh)
    bpy.context.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj

    # Two vertex groups become handles: one is fixed, one follows an empty.
    obj.vertex_groups.new(name="foot").add(np.flatnonzero(V[:, 2] < 0.5).tolist(), 1.0, "REPLACE")
    bpy.ops.sshade.handle_add()
    obj.vertex_groups.new(name="top").add(np.flatnonzero(V[:, 2] > 7.5).tolist(), 1.0, "REPLACE")
    bpy.ops.sshade.handle_add()
    bpy.ops.sshade.empty_add()
    empty = obj.sshade.handles["top"].empty

    # The live mode follows the empty; each update of the scene is a step.
    bpy.ops.sshade.live_start()
    for _ in range(20):
        empty.location.x += 0.15
        empty.location.z -= 0.05
        empty.rotation_euler.y += 0.05
        bpy.context.view_layer.update()
    obj.sshade.method = "fine"
    bpy.ops.sshade.live_finish()
    bpy.ops.wm.save_as_mainfile(filepath=path)


if __name__ == "__main__":
    main(sys.argv[-1])

# SPDX-License-Identifier: MIT OR GPL-3.0-or-later
"""Read handles and positions from Blender's objects, and write positions back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bmesh
import bpy
import numpy as np
from mathutils import Matrix

from sshade.core.errors import InputError
from sshade.edit.groups import Motion

from .rig import RIGID, STILL, Rig, RigGroup, rigid

#: Name of the shape keys that the extension makes.
KEY = "SShaDe"


def rest_positions(mesh: bpy.types.Mesh) -> np.ndarray:
    """Return the positions (n, 3) float32 of a mesh without the effect of shape keys."""
    V = np.empty((len(mesh.vertices), 3), dtype=np.float32)
    if mesh.shape_keys is None:
        # Attributes are copied a hundred times as fast as `vertices`.
        mesh.attributes["position"].data.foreach_get("vector", V.ravel())
    else:
        mesh.shape_keys.reference_key.points.foreach_get("co", V.ravel())
    return V


def corners(mesh: bpy.types.Mesh) -> np.ndarray:
    """Return the vertex (c,) int32 of each corner of each face."""
    vertex = np.empty(len(mesh.loops), dtype=np.int32)
    if len(vertex):
        mesh.attributes[".corner_vert"].data.foreach_get("value", vertex)
    return vertex


def triangles(mesh: bpy.types.Mesh) -> np.ndarray:
    """Return the faces (m, 3) int64, cut into triangles as Blender cuts them."""
    if len(mesh.loops) == 3 * len(mesh.polygons):
        return corners(mesh).reshape(-1, 3).astype(np.int64)
    mesh.calc_loop_triangles()
    F = np.empty((len(mesh.loop_triangles), 3), dtype=np.int32)
    mesh.loop_triangles.foreach_get("vertices", F.ravel())
    return F.astype(np.int64)


def group_weights(obj: bpy.types.Object, names: Sequence[str]) -> list[np.ndarray]:
    """Return the weights (n,) float32 of all vertices in some vertex groups.

    Raises
    ------
    InputError
        When there is no such vertex group.
    """
    rows = {}
    for name in names:
        if name not in obj.vertex_groups:
            raise InputError(f"object {obj.name!r} has no vertex group {name!r}")
        rows[obj.vertex_groups[name].index] = np.zeros(len(obj.data.vertices), dtype=np.float32)
    copy = bmesh.new()  # its groups are read twice as fast as those of the mesh
    copy.from_mesh(obj.data)
    layer = copy.verts.layers.deform.verify()
    for number, vertex in enumerate(copy.verts):
        for group, weight in vertex[layer].items():
            if group in rows:
                rows[group][number] = weight
    copy.free()
    return list(rows.values())


def relative(obj: bpy.types.Object, empty: bpy.types.Object) -> Matrix:
    """Return the matrix of an empty in the coordinates of an object."""
    return obj.matrix_world.inverted_safe() @ empty.matrix_world


def read_rig(obj: bpy.types.Object) -> Rig:
    """Return the mesh at rest with its handles.

    Raises
    ------
    InputError
        See :class:`sshade.blender.rig.Rig` and :func:`group_weights`.
    """
    handles = obj.sshade.handles
    names = [handle.name for handle in handles]
    weights = group_weights(obj, names)
    moves = (handle.kind != "FIXED" for handle in handles)
    groups = [RigGroup(*group) for group in zip(names, weights, moves, strict=True)]
    return Rig(rest_positions(obj.data), triangles(obj.data), groups)


def read_motions(obj: bpy.types.Object) -> list[Motion]:
    """Return the present motion of each handle, in the coordinates of the object.

    Raises
    ------
    InputError
        When the object has unequal scales, a moved group has no empty, or its motion is not rigid.
    """
    scale = [abs(factor) for factor in obj.matrix_world.to_scale()]  # all negative if the object is mirrored
    if max(scale) == 0 or max(scale) - min(scale) > RIGID * max(scale):
        raise InputError(
            f"object {obj.name!r} has scales that are unequal or zero; apply its scale (Ctrl A, Scale)"
        )
    return [_motion(obj, handle) for handle in obj.sshade.handles]


def _motion(obj: bpy.types.Object, handle: Any) -> Motion:
    if handle.kind == "FIXED":
        return STILL
    if handle.empty is None or not handle.empty.users_scene:  # a deleted one stays in the file
        raise InputError(f"group {handle.name!r} is moved, but has no empty in a scene; choose or add one")
    motion = rigid(np.array(relative(obj, handle.empty) @ handle.rest))
    if motion is None:
        raise InputError(
            f"empty {handle.empty.name!r} was scaled, or the object's scale was applied; set the scale back, "
            "or clear the empty and choose it again"
        )
    return motion


def switch_off(obj: bpy.types.Object) -> dict[str, float]:
    """Give the shape keys of this extension the value 0, as Blender adds up keys; return their values."""
    keys = obj.data.shape_keys.key_blocks if obj.data.shape_keys else ()
    values = {key.name: key.value for key in keys if key.name.partition(".")[0] == KEY}
    for name in values:
        keys[name].value = 0.0
    return values


def add_key(obj: bpy.types.Object) -> bpy.types.ShapeKey:
    """Add a shape key with the value 1 to an object, a basis if it has none, and switch off earlier keys."""
    if obj.data.shape_keys is None:
        obj.shape_key_add(name="Basis", from_mix=False)
    switch_off(obj)
    key = obj.shape_key_add(name=KEY, from_mix=False)
    key.value = 1.0
    return key


def write_key(obj: bpy.types.Object, key: bpy.types.ShapeKey, V: np.ndarray) -> None:
    """Give a shape key the positions V (n, 3) float32."""
    key.points.foreach_set("co", V.ravel())
    obj.data.update_tag()

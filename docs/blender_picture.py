"""Render the picture of docs/blender.md in Blender: ``PYTHON -m docs.blender_picture CASE.npz OUT.png``.

PYTHON and CASE are those of :mod:`docs.blender_runs`. From left to right: the rest shape with its handles,
the shape of the extension, and the shape of the modifier Laplacian Deform.
"""

from __future__ import annotations

import sys

import bpy
import numpy as np
from mathutils import Vector

import sshade.blender
from docs.blender_runs import METHODS, Case, new_object

SKIN, FIXED, MOVING, INK = (0.4, 0.38, 0.36), (0.02, 0.1, 0.8), (0.95, 0.35, 0.0), (0.05, 0.05, 0.05)
#: Size in pixels, rays for each pixel, and distance of the shapes relative to their width.
SIZE, SAMPLES, APART = (1000, 600), 16, 1.1


def material(colour: tuple[float, float, float], *, glows: bool = False) -> bpy.types.Material:
    """Return a matt material, or one that no shadow darkens."""
    made = bpy.data.materials.new("Colour")
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*colour, 1)
    shader.inputs["Roughness"].default_value = 0.7
    if glows:
        shader.inputs["Emission Color"].default_value = (*colour, 1)
        shader.inputs["Emission Strength"].default_value = 0.4
    return made


def upright(V: np.ndarray, shift: float) -> np.ndarray:
    """Return positions (n, 3) whose up is z, shifted sideways."""
    return np.stack([V[:, 0] + shift, -V[:, 2], V[:, 1]], axis=1)


def add_shape(V: np.ndarray, F: np.ndarray) -> None:
    """Add a smooth shape."""
    obj = new_object(V, F)
    obj.data.materials.append(material(SKIN))
    obj.data.shade_smooth()


def add_points(points: np.ndarray, colour: tuple[float, float, float], radius: float) -> None:
    """Add a sphere at each point."""
    paint = material(colour, glows=True)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=radius, segments=12, ring_count=8)
    sphere = bpy.context.object.data
    sphere.materials.append(paint)
    bpy.data.objects.remove(bpy.context.object)
    for point in points:
        obj = bpy.data.objects.new("Handle", sphere)
        obj.location = point
        bpy.context.collection.objects.link(obj)


def add_text(text: str, place: tuple[float, float, float], size: float) -> None:
    """Add a text that faces the camera."""
    curve = bpy.data.curves.new("Text", "FONT")
    curve.body, curve.size, curve.align_x = text, size, "CENTER"
    curve.materials.append(material(INK))
    obj = bpy.data.objects.new("Text", curve)
    obj.location, obj.rotation_euler = place, (np.pi / 2, 0, 0)
    bpy.context.collection.objects.link(obj)


def add_view(low: np.ndarray, high: np.ndarray) -> None:
    """Add a camera from the front, a light, and a white surrounding."""
    scene, middle, extent = bpy.context.scene, (low + high) / 2, high - low
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type = "ORTHO"
    camera.data.ortho_scale = 1.04 * max(extent[0], extent[2] * SIZE[0] / SIZE[1])
    camera.location, camera.rotation_euler = middle + [0, -10, 0], (np.pi / 2, 0, 0)
    light = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    light.data.energy, light.data.angle = 1.6, 0.3
    light.rotation_euler = Vector((0.5, 1.0, -0.9)).to_track_quat("-Z", "Y").to_euler()
    for obj in (camera, light):
        scene.collection.objects.link(obj)
    scene.camera, scene.world = camera, bpy.data.worlds.new("World")
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 1.0


def draw(case: Case) -> None:
    """Build the scene."""
    V, group = case["V"], case["group"]
    shapes = [V, METHODS["fast"](case)["U"], METHODS["laplacian"](case)["U"]]
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    width = max(float(np.ptp(U[:, 0])) for U in shapes) * APART
    low, high, names = [], [], ("rest and handles", "sshade, fast", "Laplacian Deform")
    for number, (U, name) in enumerate(zip(shapes, names, strict=True)):
        U = upright(U, number * width)
        add_shape(U, case["F"])
        moves = (case["motions"][group] != np.eye(4)).any(axis=(1, 2))
        for own, colour in ((~moves, FIXED), (moves, MOVING)):
            add_points(U[case["index"][own]], colour, 0.005 * float(np.ptp(V[:, 1])))
        floor = float(min(upright(shape, 0)[:, 2].min() for shape in shapes))
        add_text(name, (float(U[:, 0].min() + U[:, 0].max()) / 2, 0, floor - 0.14), 0.085)
        low.append(U.min(axis=0) - [0, 0, 0.2])
        high.append(U.max(axis=0))
    add_view(np.min(low, axis=0), np.max(high, axis=0))


def render(path: str) -> None:
    """Write the picture."""
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", SAMPLES
    scene.cycles.use_denoising = True
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode, scene.render.image_settings.compression = "RGB", 100
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    bpy.ops.wm.read_homefile(use_empty=True)
    sshade.blender.register()
    with np.load(sys.argv[1]) as file:
        draw(dict(file))
    render(sys.argv[2])

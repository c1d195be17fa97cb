"""Make the pictures, commands, times and turning views of the gallery: ``python -m docs.gallery [NAME ...]``.

The program runs the commands of :data:`EXAMPLES` in ``data/gallery``, and draws the shape before and after
each, with close-ups. The time of a command is the fastest of three. With names it draws these examples alone,
from the files that are there.
"""

from __future__ import annotations

import gzip
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import pyvista
import trimesh
from PIL import Image
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

from docs.pages import fill
from eval.run.environment import environment
from sshade import Handles, Mesh, read
from sshade.core.console import say
from sshade.files.handle_files import read_handle_file
from sshade.files.meshes import read_file, write_mesh
from sshade.files.open_shape import on_shape, open_shape
from sshade.files.skin import DrawnSkin, has_skin, skin_on
from sshade.plotting.figure import figure_of
from sshade.plotting.pictures import BODY, View, add_handles, aim, new_plotter

PAGE, FIGURES = Path(__file__).with_suffix(".md"), Path(__file__).parent / "figures"
MODELS, FOLDER = Path(__file__).parent / "models", Path("data/gallery")
#: Repeats of a command, of which the fastest counts.
REPEATS = 3
#: Height of a picture in pixels, least and greatest width of a shape, and samples of a pixel along each axis.
HEIGHT, NARROW, WIDE, FINE = 760, 430, 760, 2
#: Largest mesh that a turning view shows completely, and number of vertices of larger meshes.
TURNING = 10_000, 12_000
#: Factor of the brightness that makes the floor white, which the shadows darken a little everywhere.
WHITE = 1.05
#: Commands that write the input. :func:`write_cat` and :func:`write_clothes` write the rest.
INPUT = (
    "defaust example example",
    "defaust example large --subdivisions 4",
    "defaust build source=animals out=animals subjects=[0,1]",
)
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Detail:
    """A close-up: a point of the shape at rest, the radius around it, and the direction to the camera."""

    at: Vector
    radius: float
    towards: Vector


@dataclass(frozen=True)
class Example:
    """A command, and how to draw its input and its output.

    Parameters
    ----------
    title : str
    command : str
        ``sshade deform`` with the mesh, the handles and the output as its first arguments.
    text : str
        Sentences of the page.
    details : (Detail, Detail)
        Close-ups of the shape after the command.
    towards : (3,) tuple of float
        Direction from the scene to the camera; y points up.
    clothes : tuple of (str, str)
        Names and colours of meshes that go along.
    """

    title: str
    command: str
    text: str
    details: tuple[Detail, Detail]
    towards: Vector = (0.4, 0.18, 1.0)
    clothes: tuple[tuple[str, str], ...] = ()


SIDE = (1.0, 0.25, 0.8)
#: Examples by the names of their pictures, in the order of the page.
EXAMPLES = {
    "parts": Example(
        "Many parts",
        "sshade deform jewelled.ply animals/subject_00/pose_3.json -o parts.ply",
        "Eyes, whiskers and pearls are components without handles. They follow the cat.",
        (Detail((0, 0.28, 0.3), 0.09, (0.9, 0.15, 0.8)), Detail((0.05, 0.15, 0.12), 0.1, SIDE)),
        towards=SIDE,
    ),
    "koala": Example(
        "A koala",
        "sshade deform models/koala.ply models/koala.json -o koala.ply",
        "It waves, and turns its head. Koala by YahooJAPAN, CC BY 3.0.",
        (Detail((0.9, 0.2, 2.4), 1.5, (0.6, 0.1, 1)), Detail((0, 1.4, 4.4), 1.4, (0.6, 0.1, 1))),
        towards=(0.7, 0.2, 1.0),
    ),
    "clothes": Example(
        "Clothes",
        "sshade deform example/rest.ply example/pose_8.json -o dressed.ply --with shirt.ply skirt.ply",
        "The shirt and the skirt are separate meshes without handles.",
        (Detail((0.3, 1.35, 0), 0.22, (0.5, 0.2, 1)), Detail((0, 0.85, 0.1), 0.28, (0.4, 0.2, 1))),
        clothes=(("shirt", "#7d9cc0"), ("skirt", "#c08a7d")),
    ),
    "horse": Example(
        "A horse",
        "sshade deform animals/subject_01/rest.ply animals/subject_01/pose_3.json -o horse.ply",
        "The horse rears.",
        (Detail((0.15, 0.9, 0.5), 0.35, SIDE), Detail((0.15, 0.9, -0.6), 0.4, SIDE)),
        towards=SIDE,
    ),
    "million": Example(
        "1.8 million vertices",
        "sshade deform large/rest.ply large/pose_6.json -o million.ply",
        "The handles are at the head, the hands and the feet.",
        (Detail((0.25, 1.35, 0), 0.22, (0.4, 0.1, 1)), Detail((0, 1.62, 0.1), 0.2, (0.3, 0.05, 1))),
    ),
    "spot": Example(
        "Spot",
        "sshade deform models/spot.obj models/spot.json -o spot.obj",
        "A small mesh with a texture, which stays. Spot by Keenan Crane, in the public domain.",
        (Detail((0, 0.5, -0.5), 0.5, (0.75, 0.15, -1)), Detail((0.25, -0.4, -0.3), 0.42, (1, 0.1, -0.8))),
        towards=(0.85, 0.25, -1.0),
    ),
}


class Scene(NamedTuple):
    """What a picture shows.

    Attributes
    ----------
    mesh : Mesh
        The shape at rest, with its clothes.
    after : (n, 3) float64
    handles : Handles
    colours : (n, 3) uint8
    skin : DrawnSkin or None
    """

    mesh: Mesh
    after: np.ndarray
    handles: Handles
    colours: np.ndarray
    skin: DrawnSkin | None


def run(command: str) -> float:
    """Run a command in the folder; return its time in seconds."""
    begin = perf_counter()
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environ = os.environ | {"PATH": path}
    subprocess.run(command, shell=True, cwd=FOLDER, env=environ, check=True, capture_output=True)
    return perf_counter() - begin


def write_cat() -> None:
    """Write a cat with eyes, whiskers and a necklace. Its first vertices are those of the cat."""
    V, F = read(FOLDER / "animals/subject_00/rest.ply")
    cat = trimesh.Trimesh(V, F, process=False)
    surface = cKDTree(V)
    parts = [cat]
    for side in (-1, 1):
        eye = V[surface.query([0.045 * side, 0.325, 0.3])[1]]
        parts.append(trimesh.creation.icosphere(4, 0.011).apply_translation(eye))
        for k in range(3):
            root = V[surface.query([0.04 * side, 0.27 + 0.01 * k, 0.32])[1]]
            tip = root + [0.07 * side, 0.015 * (k - 1), 0.015]
            parts.append(trimesh.creation.cylinder(0.0009, segment=[root, tip]))
    neck = cat.section(plane_origin=[0, 0.265, 0.19], plane_normal=[0, 0.45, 0.9])
    (line,) = neck.discrete
    along = np.append(0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    places = np.linspace(0, along[-1], 25)[:-1]
    pearls = np.stack([np.interp(places, along, axis) for axis in line.T], axis=1)
    parts += [trimesh.creation.icosphere(3, 0.0055).apply_translation(at) for at in pearls]
    whole = trimesh.util.concatenate(parts)
    write_mesh(FOLDER / "jewelled.ply", whole.vertices, whole.faces)


def write_clothes() -> None:
    """Write a shirt, which is a part of the body moved outwards, and a skirt, which is a part of a cone."""
    V, F = read(FOLDER / "example/rest.ply")
    x, y, _ = V.T
    inside = (abs(x) < 0.32) & (y > 0.98) & (y < 1.45)
    body = trimesh.Trimesh(V, F, process=False)
    V = V + 0.008 * body.vertex_normals
    F = F[inside[F].all(axis=1)]
    used, F = np.unique(F, return_inverse=True)
    write_mesh(FOLDER / "shirt.ply", V[used], F.reshape(-1, 3))
    t = np.linspace(0, 1, 80)
    skirt = trimesh.creation.revolve(np.stack([0.16 + 0.12 * t, -0.48 * t], axis=1), sections=160)
    width, depth, height = np.asarray(skirt.vertices).T
    placed = np.stack([width, 1.04 + height, 0.02 + 0.75 * depth], axis=1)
    write_mesh(FOLDER / "skirt.ply", placed, skirt.faces[:, ::-1])


def scene_of(example: Example) -> Scene:
    """Read the files of an example."""
    _, _, rest, pose, _, output, *_ = example.command.split()
    file = read_file(FOLDER / rest)
    shape = open_shape(file)
    handles = on_shape(read_handle_file(FOLDER / pose), shape)
    colour = np.array(pyvista.Color(BODY).int_rgb, dtype=np.uint8)
    V, W = shape.mesh.V, read(FOLDER / output).V[shape.surface.original]
    parts = [(V, W, shape.mesh.F, np.tile(colour, (len(V), 1)))]
    for cloth, name in example.clothes:
        before, F = read(FOLDER / f"{cloth}.ply")
        after = read(FOLDER / f"{Path(output).stem}_{cloth}.ply").V
        parts.append((before, after, F, np.tile(np.uint8(pyvista.Color(name).int_rgb), (len(before), 1))))
    first = np.cumsum([0, *(len(part[0]) for part in parts)])
    F = np.concatenate([part[2] + k for part, k in zip(parts, first, strict=False)])
    V, W, colours = (np.concatenate([part[k] for part in parts]) for k in (0, 1, 3))
    mesh = Mesh(V, F)
    skin = skin_on(file, shape.surface) if has_skin(file) else None
    return Scene(mesh, W, replace(handles, extent=mesh.diagonal), colours, skin)


def add_surface(plotter: Any, scene: Scene, V: np.ndarray) -> None:
    """Add a shape with its colours or its texture."""
    light = {"smooth_shading": True, "ambient": 0.2, "diffuse": 0.72}
    if scene.skin is None:
        surface = pyvista.PolyData.from_regular_faces(V, scene.mesh.F)
        plotter.add_mesh(surface, scalars=scene.colours, rgb=True, **light)
        return
    skin, (material,) = scene.skin, scene.skin.materials
    surface = pyvista.PolyData.from_regular_faces(V[skin.vertex], skin.faces)
    surface.active_texture_coordinates = (skin.uv * [1, -1] + [0, 1]).astype(np.float32)
    texture = pyvista.Texture(np.asarray(Image.open(BytesIO(material.texture())).convert("RGB")))
    texture.interpolate = True
    normals = pyvista.PolyData.from_regular_faces(V, scene.mesh.F).point_normals  # without seams
    surface.point_data.active_normals = normals[skin.vertex]
    plotter.add_mesh(
        surface, texture=texture, **light | {"smooth_shading": False}
    ).prop.interpolation = "Phong"


def add_floor(plotter: Any, mesh: Mesh, height: float, size: float) -> None:
    """Add a white floor with the soft shadow of a shape: darker below what is near."""
    points, _ = trimesh.sample.sample_surface(trimesh.Trimesh(mesh.V, mesh.F, process=False), 400_000, seed=0)
    x, y, z = points.T
    middle = 0.5 * np.array([x.min() + x.max(), z.min() + z.max()])
    line = np.linspace(-0.8, 0.8, 257) * size
    dark = np.zeros((256, 256))
    for near, blur, strength in ((0.02, 3, 0.45), (0.25, 12, 0.4)):
        weight = np.exp(-(y - height) / (near * size))
        hits, *_ = np.histogram2d(x - middle[0], z - middle[1], bins=(line, line), weights=weight)
        dark = np.maximum(dark, strength * gaussian_filter(1 - np.exp(-hits / 4), blur))
    a, b = np.meshgrid(0.5 * (line[1:] + line[:-1]), 0.5 * (line[1:] + line[:-1]), indexing="ij")
    floor = pyvista.StructuredGrid(a + middle[0], np.full_like(a, height), b + middle[1])
    grey = np.uint8(255 * (1 - dark)).ravel(order="F")
    plotter.add_mesh(floor, scalars=np.stack([grey] * 3, axis=1), rgb=True, lighting=False)


def rendered(
    scene: Scene, V: np.ndarray, view: View, size: tuple[int, int], *, whole: bool = True, rest: bool = False
) -> Image.Image:
    """Return a picture of a shape with soft shadows; of a whole one with a floor, at rest with handles."""
    plotter = new_plotter(window_size=tuple(FINE * side for side in size), lighting="three lights")
    add_surface(plotter, scene, V)
    if whole:
        low = min(scene.mesh.V[:, 1].min(), scene.after[:, 1].min())
        add_floor(plotter, Mesh(V, scene.mesh.F), low, scene.mesh.diagonal)
    if rest:
        add_handles(plotter, V, scene.handles, size=scene.mesh.diagonal, targets=True)
    aim(plotter, view)
    span = scene.mesh.diagonal
    plotter.enable_ssao(radius=0.04 * span, bias=0.006 * span, kernel_size=96, blur=True)
    image = Image.fromarray(plotter.screenshot(return_img=True))
    plotter.close()
    return image.resize(size, Image.Resampling.LANCZOS).point(lambda x: min(255, int(x * WHITE)))


def drawn(example: Example, scene: Scene) -> Image.Image:
    """Return a picture of the shapes before and after a command at one scale, and of details."""
    V, W, margin = scene.mesh.V, scene.after, 0.04 * scene.mesh.diagonal
    shapes = [V, W]
    both = View.of([V, W, scene.handles.target - [0, margin, 0]], towards=example.towards)
    views = [View.of([shape], towards=example.towards) for shape in shapes]
    extent = np.array([max(view.size[0] for view in views), *both.size[1:]])
    width = int(np.clip(HEIGHT * extent[0] / extent[1], NARROW, WIDE))
    small = HEIGHT // 2
    picture = Image.new("RGB", (2 * width + small, HEIGHT), "white")
    for column, (shape, view) in enumerate(zip(shapes, views, strict=True)):
        across = both.axes[0] * (both.axes[0] @ (view.centre - both.centre))
        own = View(both.axes, both.centre + across, extent)
        picture.paste(rendered(scene, shape, own, (width, HEIGHT), rest=not column), (column * width, 0))
    for row, detail in enumerate(example.details):
        near = np.linalg.norm(V - detail.at, axis=1).argmin()
        view = View.of([W], towards=detail.towards)
        view = View(view.axes, W[near], np.array([2 * detail.radius, 2 * detail.radius, view.size[2]]))
        close = rendered(scene, W, view, (small - 8, small - 8), whole=False)
        picture.paste(close, (2 * width + 8, row * small + 4))
    return picture


def save(image: Image.Image, path: Path, colours: int = 128) -> None:
    """Write a picture of few colours."""
    image.quantize(colours, kmeans=1, dither=Image.Dither.NONE).save(path, optimize=True)
    say(f"{path}: {path.stat().st_size / 1000:.0f} kB")


def write_turning(name: str, scene: Scene) -> None:
    """Write the page of a turning view, compressed; docs/site.py adds it to the website."""
    example = EXAMPLES[name]
    look: dict[str, Any] = {"camera": (example.towards, (0.0, 1.0, 0.0)), "size": TURNING}
    look |= {"skin": scene.skin} if scene.skin else {"colours": scene.colours} if example.clothes else {}
    page = figure_of(scene.mesh, scene.handles, {"after": scene.after}, **look).page
    path = FIGURES / f"turn_{name}.html.gz"
    path.write_bytes(gzip.compress(page.encode(), mtime=0))
    say(f"{path}: {path.stat().st_size / 1000:.0f} kB")


def draw(name: str) -> int:
    """Draw an example and write its turning view; return its number of vertices."""
    example = EXAMPLES[name]
    scene = scene_of(example)
    save(drawn(example, scene), FIGURES / f"gallery_{name}.png", 256)
    write_turning(name, scene)
    return len(read(FOLDER / example.command.split()[2]).V)


def section(name: str, vertices: int, seconds: float) -> str:
    """Return a section of the page."""
    example = EXAMPLES[name]
    picture = f"![{example.title} before and after](figures/gallery_{name}.png)"
    turn = f"[Turn it](figures/turn_{name}.html.gz) on the website."
    parts = f"## {example.title}", picture, f"```\n{example.command}\n```"
    return "\n\n".join([*parts, f"{example.text} {vertices:,} vertices, {seconds:.1f} s. {turn}"])


def main(names: list[str]) -> None:
    """Run the commands, draw their pictures and write the page."""
    if names:
        for name in names:
            draw(name)
        return
    FOLDER.mkdir(parents=True, exist_ok=True)
    for command in INPUT:
        say(f"{command}: {run(command):.1f} s")
    shutil.copytree(MODELS, FOLDER / "models", dirs_exist_ok=True)
    write_cat()
    write_clothes()
    sections = []
    for name, example in EXAMPLES.items():
        seconds = min(run(example.command) for _ in range(REPEATS))
        say(f"{example.command}: {seconds:.1f} s")
        sections.append(section(name, draw(name), seconds))
    sections.append(f"Machine of the times: {environment(jobs=1)['machine']}.")
    fill(PAGE, "examples", "\n\n".join(sections))


if __name__ == "__main__":
    main(sys.argv[1:])

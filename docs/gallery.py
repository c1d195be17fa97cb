"""Make the pictures, commands and times of docs/gallery.md: ``python -m docs.gallery [FOLDER]``.

The program runs the commands of :data:`EXAMPLES` in FOLDER, by default ``data/gallery``, and draws the shape
before and after each, also for the README. The time of a command is the fastest of three.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
import pyvista
import trimesh
from PIL import Image, ImageDraw, ImageFont
from scipy.spatial import cKDTree

from docs.pages import fill
from eval.run.environment import environment
from sshade import Mesh, read, read_handles
from sshade.core.console import say
from sshade.files.meshes import write_mesh
from sshade.plotting.pictures import View, new_plotter, panel

PAGE, FIGURES = Path(__file__).with_suffix(".md"), Path(__file__).parent / "figures"
#: Repeats of a command, of which the fastest counts.
REPEATS = 3
#: Size in pixels of a picture of two shapes, height of its title on the README, and number of colours.
PICTURE, TITLE, COLOURS = (600, 300), 26, 128
#: Commands that write the input. :func:`write_cat` and :func:`write_clothes` write the rest.
INPUT = (
    "defaust example example",
    "defaust example large --subdivisions 4",
    "defaust build source=animals out=animals subjects=[0,1]",
    "defaust build source=shapes out=shapes subjects=[3]",
)
Vector = tuple[float, float, float]


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
    towards, up : (3,) tuple of float
        Direction from the scene to the camera, and upright direction.
    clothes : tuple of (str, str)
        Names and colours of meshes that go along.
    """

    title: str
    command: str
    text: str
    towards: Vector = (0.4, 0.15, 1.0)
    up: Vector = (0.0, 1.0, 0.0)
    clothes: tuple[tuple[str, str], ...] = ()


SIDE = (1.0, 0.25, 0.8)
#: Examples by the names of their pictures, in the order of the page.
EXAMPLES = {
    "body": Example(
        "A body",
        "sshade deform example/rest.ply example/pose_6.json -o body.ply",
        "The handles are at the head, the hands and the feet.",
    ),
    "cat": Example(
        "A cat",
        "sshade deform animals/subject_00/rest.ply animals/subject_00/pose_2.json -o cat.ply",
        "The cat sits down.",
        towards=SIDE,
    ),
    "horse": Example(
        "A horse",
        "sshade deform animals/subject_01/rest.ply animals/subject_01/pose_3.json -o horse.ply",
        "The horse rears.",
        towards=SIDE,
    ),
    "cactus": Example(
        "A cactus",
        "sshade deform shapes/subject_03/rest.ply shapes/subject_03/pose_1.json -o cactus.ply",
        "The foot is fixed, and the top moves and turns.",
        towards=(0.3, -1.0, 0.2),
        up=(0.0, 0.0, 1.0),
    ),
    "parts": Example(
        "Many parts",
        "sshade deform jewelled.ply animals/subject_00/pose_3.json -o parts.ply",
        "Eyes, whiskers and pearls are components without handles. They follow the cat.",
        towards=SIDE,
    ),
    "million": Example(
        "1.8 million vertices",
        "sshade deform large/rest.ply large/pose_1.json -o million.ply",
        "The body of the first example, subdivided twice more.",
    ),
    "clothes": Example(
        "Clothes",
        "sshade deform example/rest.ply example/pose_8.json -o dressed.ply --with shirt.ply skirt.ply",
        "The shirt and the skirt are separate meshes without handles.",
        clothes=(("shirt", "#7d9cc0"), ("skirt", "#c08a7d")),
    ),
}
#: Examples of the README, in rows of two.
README = ("million", "clothes", "cat", "horse", "cactus", "parts")


def run(command: str, folder: Path) -> float:
    """Run a command in a folder; return its time in seconds."""
    begin = perf_counter()
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environ = os.environ | {"PATH": path}
    subprocess.run(command, shell=True, cwd=folder, env=environ, check=True, capture_output=True)
    return perf_counter() - begin


def write_cat(folder: Path) -> None:
    """Write a cat with eyes, whiskers and a necklace. Its first vertices are those of the cat."""
    V, F = read(folder / "animals/subject_00/rest.ply")
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
    write_mesh(folder / "jewelled.ply", whole.vertices, whole.faces)


def write_clothes(folder: Path) -> None:
    """Write a shirt, which is a part of the body moved outwards, and a skirt, which is a part of a cone."""
    V, F = read(folder / "example/rest.ply")
    x, y, _ = V.T
    inside = (abs(x) < 0.32) & (y > 0.98) & (y < 1.45)
    body = trimesh.Trimesh(V, F, process=False)
    V = V + 0.008 * body.vertex_normals
    F = F[inside[F].all(axis=1)]
    used, F = np.unique(F, return_inverse=True)
    write_mesh(folder / "shirt.ply", V[used], F.reshape(-1, 3))
    t = np.linspace(0, 1, 80)
    skirt = trimesh.creation.revolve(np.stack([0.16 + 0.12 * t, -0.48 * t], axis=1), sections=160)
    width, depth, height = np.asarray(skirt.vertices).T
    placed = np.stack([width, 1.04 + height, 0.02 + 0.75 * depth], axis=1)
    write_mesh(folder / "skirt.ply", placed, skirt.faces[:, ::-1])


def drawn(example: Example, folder: Path, size: tuple[int, int]) -> Image.Image:
    """Return a picture of the shapes before and after a command, side by side at one scale."""
    _, _, rest, handles, _, output, *_ = example.command.split()
    mesh = Mesh(*read(folder / rest))
    shapes = {"": mesh.V, f"{Path(output).stem}_": read(folder / output).V}
    marks = read_handles(folder / handles, mesh)
    views = [View.of([V], towards=example.towards, up=example.up) for V in shapes.values()]
    extent = np.max([view.size for view in views], axis=0)
    plotter = new_plotter(shape=(1, 2), window_size=size, lighting="three lights")
    for column, ((name, V), view) in enumerate(zip(shapes.items(), views, strict=True)):
        plotter.subplot(0, column)
        for cloth, colour in example.clothes:
            plotter.add_mesh(pyvista.read(folder / f"{name}{cloth}.ply"), color=colour, smooth_shading=True)
        panel(plotter, mesh, V, View(view.axes, view.centre, extent), handles=marks)
    image = Image.fromarray(plotter.screenshot(return_img=True))
    plotter.close()
    return image


def save(image: Image.Image, path: Path) -> None:
    """Write a picture of few colours."""
    image.quantize(COLOURS, kmeans=1, dither=Image.Dither.NONE).save(path, optimize=True)
    say(f"{path}: {path.stat().st_size / 1000:.0f} kB")


def section(name: str, folder: Path, seconds: float) -> str:
    """Return a section of the page."""
    example = EXAMPLES[name]
    n = len(read(folder / example.command.split()[2]).V)
    picture = f"![{example.title} before and after](figures/gallery_{name}.png)"
    parts = f"## {example.title}", picture, f"```\n{example.command}\n```"
    return "\n\n".join([*parts, f"{example.text} {n:,} vertices, {seconds:.1f} s."])


def titled(pictures: dict[str, Image.Image]) -> Image.Image:
    """Return a picture of two columns of pictures with titles."""
    width, height = PICTURE
    rows = (len(pictures) + 1) // 2
    whole = Image.new("RGB", (2 * width, rows * (height + TITLE)), "white")
    pen, font = ImageDraw.Draw(whole), ImageFont.load_default(18)
    for k, (title, picture) in enumerate(pictures.items()):
        x, y = k % 2 * width, k // 2 * (height + TITLE)
        whole.paste(picture, (x, y + TITLE))
        pen.text((x + width // 2, y + TITLE // 2), title, "black", font, anchor="mm")
    return whole


def main(folder: Path) -> None:
    """Run the commands, draw their pictures and write the page."""
    folder.mkdir(parents=True, exist_ok=True)
    for command in INPUT:
        say(f"{command}: {run(command, folder):.1f} s")
    write_cat(folder)
    write_clothes(folder)
    sections, pictures = [], {}
    for name, example in EXAMPLES.items():
        seconds = min(run(example.command, folder) for _ in range(REPEATS))
        say(f"{example.command}: {seconds:.1f} s")
        pictures[name] = drawn(example, folder, PICTURE)
        save(pictures[name], FIGURES / f"gallery_{name}.png")
        sections.append(section(name, folder, seconds))
    save(titled({EXAMPLES[name].title: pictures[name] for name in README}), FIGURES / "gallery.png")
    sections.append(f"Machine of the times: {environment(jobs=1)['machine']}.")
    fill(PAGE, "examples", "\n\n".join(sections))


if __name__ == "__main__":
    main(Path(*sys.argv[1:] or ["data/gallery"]))

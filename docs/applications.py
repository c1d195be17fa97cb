"""Run the examples of docs/applications.md, and draw its pictures: ``python -m docs.applications``."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from contextlib import chdir
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from PIL import Image

from defaust.example import write_example
from docs.gallery import save
from eval.publish.plotting import picture
from sshade import Handles, Mesh, read
from sshade.files.meshes import write_mesh
from sshade.plotting.pictures import View

PAGE, FIGURES = Path(__file__).with_suffix(".md"), Path(__file__).with_name("figures")
#: Width of a shape in pixels.
WIDTH = 200


def run_examples(folder: Path, *, subdivisions: int) -> dict[str, Any]:
    """Run the code and the commands of the page in a folder, in their order; return the names of the code."""
    write_example(folder / "example", subdivisions=subdivisions)
    names: dict[str, Any] = {}
    with chdir(folder):
        write_scene()
        for language, block in re.findall(r"^```(\w*)\n(.*?)^```$", PAGE.read_text("utf-8"), re.M | re.S):
            if language == "python":
                exec(block, names)
            else:
                subprocess.run([sys.executable, "-m", *shlex.split(block)], check=True)
    return names


def write_scene() -> None:
    """Write a body under the name of the page's mesh, and a scene of Implicit-ARAP that turns its arm."""
    V, F = read("example/rest.ply")
    mesh = Mesh(V, F)
    write_mesh("armadillo.ply", V, F)
    centre = np.average(V[F].mean(axis=1), axis=0, weights=mesh.face_areas)
    scaled = 0.8 * (V - centre) / np.abs(V - centre).max()
    near = {"left_foot": V[:, 1] - V[:, 0], "right_foot": V[:, 1] + V[:, 0], "right_hand": -V[:, 0]}
    step = len(V) // 6890
    parts = {name: scaled[np.argsort(values)[: 70 * step : step]] for name, values in near.items()}
    turn = np.array([[0.5, 0, -(0.75**0.5)], [0, 1, 0], [0.75**0.5, 0, 0.5]])
    scene = Path("constraints/armadillo")
    for kind in ("parts", "transforms"):
        (scene / kind).mkdir(parents=True)
    for name, points in parts.items():
        np.savetxt(scene / "parts" / f"{name}.txt", points)
    np.savetxt(scene / "transforms" / "arm_front.txt", parts["right_hand"] @ turn.T)
    text = "moving: {positions: [right_hand], transform: [arm_front]}}\n"
    text = f"handles: {{static: {{positions: [left_foot, right_foot]}}, {text}"
    (scene / "arm_front.yaml").write_text(text)


def pictures(names: dict[str, Any]) -> dict[str, Image.Image]:
    """Return the pictures by the ends of their names, from the names that the code of the page leaves."""
    mesh, proxy, posed, rebuilt = (names[name] for name in ("mesh", "proxy", "posed", "rebuilt"))
    body, scene, pose = (mesh, mesh.V), names["armadillo"], (mesh, posed)
    bent = (scene, names["result"].vertices)
    twisted = (proxy, read("twisted.ply").V), (mesh, names["twisted_body"])
    error = np.linalg.norm(rebuilt - posed, axis=1)
    return {
        "transfer": strip(body, pose, (mesh, names["edited"]), (mesh, names["edited_posed"])),
        "rebuilt": strip(body, pose, (mesh, rebuilt), values=[None, None, error]),
        "proxy": strip(body, (proxy, proxy.V), *twisted),
        "scene": strip((scene, scene.V), bent, handles=names["handles"]),
        "function": strip((proxy, proxy.V), body, values=[names["coarse"], names["distance"]]),
    }


def strip(
    *shapes: tuple[Mesh, np.ndarray],
    values: Sequence[np.ndarray | None] | None = None,
    handles: Handles | None = None,
) -> Image.Image:
    """Draw shapes of meshes side by side at one scale; values of their vertices colour them."""
    centred = [V - 0.5 * (V.min(axis=0) + V.max(axis=0)) for _, V in shapes]
    view = View.of(centred, towards=(0.9, 0.1, 0.8))
    panels = []
    for (mesh, _), V, own in zip(shapes, centred, values or [None] * len(shapes), strict=True):
        paint = {} if own is None else {"error": own, "top": float(own.max())}
        panels.append(picture(mesh, V, view=view, width=WIDTH, handles=handles, **paint))
    return Image.fromarray(np.hstack(panels))


def main() -> None:
    """Run the examples on a body of 110,000 vertices, and write the pictures."""
    with TemporaryDirectory() as folder, chdir(folder):
        for name, image in pictures(run_examples(Path(folder), subdivisions=2)).items():
            save(image, FIGURES / f"applications_{name}.png")


if __name__ == "__main__":
    main()

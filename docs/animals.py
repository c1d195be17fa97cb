"""Draw the animals at rest and in their poses for animals.md: ``python -m docs.animals``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

PICTURE = Path(__file__).parent / "figures" / "animals.png"
#: Size of a panel in pixels, and number of colours of the picture.
PANEL, TONES = (220, 176), 160
REST, POSED = "#b8b8b8", "#d9b38c"


def picture() -> None:
    """Draw a row for each species: the rest shape in grey, then the four poses."""
    import pyvista
    from PIL import Image

    from defaust.sources.animals import SPECIES, Animals

    source = Animals()
    size = 5 * PANEL[0], len(SPECIES) * PANEL[1]
    plotter = pyvista.Plotter(shape=(len(SPECIES), 5), off_screen=True, window_size=size, border=False)
    for row, species in enumerate(SPECIES):
        rest = source.rest(row)
        shapes = {"rest": rest} | {pose.name: source.posed(row, pose) for pose in source.poses(row)}
        towards = np.array([1.0, 0.9 if species == "lizard" else 0.45, 0.75])
        for column, (name, mesh) in enumerate(shapes.items()):
            plotter.subplot(row, column)
            shown = pyvista.PolyData.from_regular_faces(mesh.V, mesh.F)
            plotter.add_mesh(shown, color=POSED if column else REST, smooth_shading=True)
            plotter.add_text(f"{species}: {name.replace('_', ' ')}", font_size=7, color="black")
            _aim(plotter.camera, mesh.V, towards / np.linalg.norm(towards), diagonal=rest.diagonal)
    image = Image.fromarray(plotter.screenshot(return_img=True))
    image.quantize(TONES, dither=Image.Dither.NONE).save(PICTURE, optimize=True)
    plotter.close()


def _aim(camera: Any, V: np.ndarray, towards: np.ndarray, *, diagonal: float) -> None:
    """Centre a shape in the panel, at the scale of its species, or smaller if it does not fit."""
    right = np.cross([0.0, 1.0, 0.0], towards)
    axes = np.stack(
        [right / np.linalg.norm(right), np.cross(towards, right) / np.linalg.norm(right), towards]
    )
    across = V @ axes.T
    centre = 0.5 * (across.min(axis=0) + across.max(axis=0)) @ axes
    width, height, _ = np.ptp(across, axis=0)
    camera.focal_point, camera.position = centre, centre + 2.0 * diagonal * towards
    camera.up, camera.parallel_projection = (0.0, 1.0, 0.0), True
    camera.parallel_scale = 0.55 * max(0.6 * diagonal, height, width * PANEL[1] / PANEL[0])


if __name__ == "__main__":
    picture()

"""Draw the animals at rest and in their poses for tracks.md: ``python -m docs.animals``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from defaust.sources.animals import SPECIES, Animals
from sshade.plotting.pictures import View, new_plotter, panel

PICTURE = Path(__file__).parent / "figures" / "animals.png"
#: Size of a panel in pixels, and number of colours of the picture.
PANEL, TONES = (220, 176), 160


def picture() -> None:
    """Draw a row for each species: the rest shape, then the four poses, at one scale."""
    from PIL import Image

    source = Animals()
    size = 5 * PANEL[0], len(SPECIES) * PANEL[1]
    plotter = new_plotter(shape=(len(SPECIES), 5), window_size=size)
    for row, species in enumerate(SPECIES):
        rest = source.rest(row)
        shapes = {"rest": rest.V} | {pose.name: source.posed(row, pose).V for pose in source.poses(row)}
        towards = 1.0, 0.9 if species == "lizard" else 0.45, 0.75
        views = [View.of([V], towards=towards) for V in shapes.values()]
        extent = np.max([view.size for view in views], axis=0)
        for column, (name, V) in enumerate(shapes.items()):
            plotter.subplot(row, column)
            panel(plotter, rest, V, replace(views[column], size=extent))
            plotter.add_text(f"{species}: {name.replace('_', ' ')}", font_size=7, color="black")
    image = Image.fromarray(plotter.screenshot(return_img=True))
    image.quantize(TONES, dither=Image.Dither.NONE).save(PICTURE, optimize=True)
    plotter.close()


if __name__ == "__main__":
    picture()

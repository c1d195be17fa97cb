"""Draw the poses of two datasets for tracks.md: ``python -m docs.tracks``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from defaust.sources.choices import OneTemplate
from defaust.sources.new_bodies import NewBodies
from defaust.sources.noisy import NoisyBodies

FIGURES = Path(__file__).with_name("figures")
#: Pictures with their source and two subjects.
PICTURES = {
    "tracks_poses": (NoisyBodies(noise=0.0), (1, 6)),
    "tracks_new_bodies": (NewBodies(), (10, 13)),
}


def picture(path: Path, source: OneTemplate, subjects: tuple[int, int]) -> None:
    """Draw the poses of two subjects."""
    import pyvista

    columns = len(source.poses(subjects[0]))
    size = (220 * columns, 700)
    plotter = pyvista.Plotter(shape=(2, columns), off_screen=True, window_size=size, border=False)
    for row, subject in enumerate(subjects):
        for column, pose in enumerate(source.poses(subject)):
            mesh = source.posed(subject, pose)
            faces = np.column_stack([np.full(mesh.m, 3), mesh.F]).ravel()
            plotter.subplot(row, column)
            plotter.add_mesh(pyvista.PolyData(mesh.V, faces), color="#d0d4dc", smooth_shading=True)
            plotter.add_text(pose.name.replace("_", " "), font_size=8, position="upper_edge")
            centre = 0.5 * (mesh.V.min(axis=0) + mesh.V.max(axis=0))
            plotter.camera_position = [tuple(centre + [1.7, 0.6, 4.2]), tuple(centre), (0.0, 1.0, 0.0)]
            plotter.camera.view_angle = 30.0
    plotter.screenshot(path)
    plotter.close()


if __name__ == "__main__":
    for name, (source, subjects) in PICTURES.items():
        picture(FIGURES / f"{name}.png", source, subjects)

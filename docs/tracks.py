"""Write the tables of tracks.md from tracks.csv: ``python -m docs.tracks``.

``--measure FOLDER ...`` writes tracks.csv first, from the noisy bodies that ``defaust build source=noisy``
builds. It measures the handles, and deforms the bodies by `paper` and `fast`. ``--picture`` draws the poses.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from defaust.folder.record import read_dataset
from defaust.sources.choices import OneTemplate
from defaust.sources.new_bodies import NewBodies
from defaust.sources.noisy import NoisyBodies
from defaust.tasks import list_tasks, load_task
from docs.blocks import fill, markdown
from sshade import DeformationTask, deform
from sshade.core.console import say
from sshade.mesh.rigid import rigid_motion

PAGE = Path(__file__).with_suffix(".md")
ROWS = PAGE.with_suffix(".csv")
#: Pictures with their source and two subjects.
PICTURES = {
    "tracks_poses": (NoisyBodies(noise=0.0), (1, 6)),
    "tracks_new_bodies": (NewBodies(), (10, 13)),
}
#: Subjects that are measured.
SUBJECTS = (0, 1, 5, 6)
#: Columns of the distances to the ground truth, with the methods and their options.
METHODS: dict[str, dict[str, Any]] = {
    "paper": {"method": "paper", "vertices": 1500},
    "fast": {"method": "fast", "vertices": 3000},
    "fast_unattached": {"method": "fast", "vertices": 3000, "attachment": 0.0},
}


def measure(folders: list[Path]) -> None:
    """Write tracks.csv: a row for each case of the datasets."""
    rows = []
    for root in folders:
        poses = {
            (subject["subject"], pose["pose"]): pose
            for subject in read_dataset(root)["subjects"]
            for pose in subject["poses"]
        }
        for case in list_tasks(root, subjects=SUBJECTS):
            task = load_task(root, subject=case.subject, pose=case.pose)
            rows.append(row_of(task, {group["landmark"]: group for group in poses[case]["groups"]}))
            say(f"{rows[-1]}")
    pd.DataFrame(rows).to_csv(ROWS, index=False, float_format="%.4f", lineterminator="\n")


def row_of(task: DeformationTask, measured: dict[str, Any]) -> dict[str, Any]:
    """Return the measures of the groups of handles that move, and the mean distances to the ground truth."""
    assert task.truth is not None
    found: dict[str, dict[str, float]] = {}
    for number, (name, facts) in enumerate(measured.items()):
        own = (task.handles.group == number) & task.handles.dynamic
        if own.any():  # static handles stay at rest, without noise
            index = task.handles.index[own]
            goals = task.handles.target[own], task.truth[index]
            R, S = (rigid_motion(task.mesh.V[index], P)[0] for P in goals)
            off = np.degrees(Rotation.from_matrix(R @ S.T).magnitude())
            found[name] = {"off": off, "residual": 100 * facts["residual"], "turned": facts["turned"]}
    row = {"task": task.name, "pose": task.meta["source_pose"]}
    row["hands_turned"] = np.mean([one["turned"] for name, one in found.items() if name.startswith("hand")])
    for name in ("off", "residual"):
        values = [one[name] for one in found.values()]
        row |= {f"{name}_mean": np.mean(values), f"{name}_max": np.max(values)}
    for name, options in METHODS.items():
        distance = np.linalg.norm(deform(task, **options).vertices - task.truth, axis=1).mean()
        row[name] = 100 * distance / task.mesh.diagonal
    return row


def tables() -> dict[str, str]:
    """Return the tables of the page by the names of their blocks, from tracks.csv."""
    rows = pd.read_csv(ROWS)
    lines = []
    for pose, own in rows.groupby("pose", sort=False):
        farther = int((own["fast"] > own["paper"]).sum())
        lines.append(
            {
                "pose": str(pose),
                "cases": f"{len(own)}",
                "hands turned (°)": f"{own['hands_turned'].mean():.1f}",
                "fits off (°)": f"{own['off_mean'].mean():.1f} (to {own['off_max'].max():.1f})",
                "residual (%)": f"{own['residual_mean'].mean():.1f} (to {own['residual_max'].max():.1f})",
                "truth, `paper` (%)": f"{own['paper'].mean():.2f}",
                "truth, `fast` (%)": f"{own['fast'].mean():.2f}",
                "without attachment (%)": f"{own['fast_unattached'].mean():.2f}",
                "`fast` farther": f"{farther}/{len(own)}",
            }
        )
    return {"poses": markdown(list(lines[0]), [list(line.values()) for line in lines])}


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
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--measure", type=Path, nargs="+", metavar="FOLDER", help="make tracks.csv first")
    parser.add_argument("--picture", action="store_true", help="draw the poses")
    options = parser.parse_args()
    if options.measure:
        measure(options.measure)
    if options.picture:
        for name, (source, subjects) in PICTURES.items():
            picture(PAGE.parent / "figures" / f"{name}.png", source, subjects)
    fill(PAGE, tables())

"""Write the tables of tracks.md from tracks.csv, or measure a version of the package on the noisy bodies.

Three steps, of which the second runs in the environment of any version, also of one before this dataset::

    python -m docs.tracks write out/tracks --data data/noisy_25k_1mm data/noisy_25k_2mm data/noisy_25k_4mm
    ENVIRONMENT/bin/python docs/tracks.py solve out/tracks
    python -m docs.tracks table out/tracks

The first step loads the tasks and writes them as arrays, with their ground truths. It measures the handles.
The second step deforms them by ``paper`` and ``fast``. The third step joins both into tracks.csv and fills
the page. Without arguments the page is filled from tracks.csv; ``picture`` draws the poses.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

PAGE = Path(__file__).with_suffix(".md")
ROWS = PAGE.with_suffix(".csv")
PICTURE = PAGE.parent / "figures" / "tracks_poses.png"
#: Subjects of the picture, one of each half.
DRAWN = (1, 6)
#: Methods: name in this version; function in old versions; vertices of the proxy; whether handles
#: attach the surface around them.
METHODS = {
    "paper": ("paper", "sshade", 1500, True),
    "fast": ("fast", "sshade_fast", 3000, True),
    "fast_unattached": ("fast", "sshade_fast", 3000, False),
}


def write(folder: Path, *, data: list[Path], subjects: list[int]) -> None:
    """Write the tasks of datasets as .npz files, with measures of their handles."""
    from defaust.folder.record import read_dataset
    from defaust.tasks import list_tasks, load_task

    folder.mkdir(parents=True, exist_ok=True)
    for root in data:
        poses = {
            (subject["subject"], pose["pose"]): pose
            for subject in read_dataset(root)["subjects"]
            for pose in subject["poses"]
        }
        for case in list_tasks(root, subjects=subjects):
            task = load_task(root, subject=case.subject, pose=case.pose)
            fits = _fits(task, {group["landmark"]: group for group in poses[case]["groups"]})
            facts = {"task": task.name, "pose": task.meta["source_pose"], "groups": fits}
            np.savez(
                folder / f"{task.name.replace('/', '-')}.npz",
                V=task.mesh.V,
                F=task.mesh.F,
                truth=task.truth,
                **{name: getattr(task.handles, name) for name in ("index", "target", "dynamic", "group")},
                facts=json.dumps(facts),
            )


def _fits(task: Any, measured: dict[str, Any]) -> list[dict[str, Any]]:
    """Measures of each group that moves; ``off`` is the error in degrees of the rotation fitted to it."""
    from scipy.spatial.transform import Rotation

    from sshade.mesh.rigid import rigid_motion

    found, names = [], list(measured)
    for number, name in enumerate(names):
        own = (task.handles.group == number) & task.handles.dynamic
        if not own.any():  # static handles stay at rest, without noise
            continue
        rest, noisy = task.mesh.V[task.handles.index[own]], task.handles.target[own]
        R, S = (rigid_motion(rest, P)[0] for P in (noisy, task.truth[task.handles.index[own]]))
        off = np.degrees(Rotation.from_matrix(R @ S.T).magnitude())
        found.append(measured[name] | {"off": float(off)})
    return found


def solve(folder: Path) -> None:
    """Deform the tasks of a folder with the installed version, and write the mean distances to the truth."""
    from sshade import DeformationTask, Handles, Mesh

    found = {}
    for path in sorted(folder.glob("*.npz")):
        with np.load(path) as file:
            arrays = dict(file)
        handles = Handles(arrays["index"], arrays["target"], dynamic=arrays["dynamic"], group=arrays["group"])
        task = DeformationTask(path.stem, Mesh(arrays["V"], arrays["F"]), handles)
        found[path.stem] = {}
        for method in METHODS:
            moved = _deformed(task, method)
            distance = np.linalg.norm(moved - arrays["truth"], axis=1).mean()
            found[path.stem][method] = float(100 * distance / task.mesh.diagonal)
            print(path.stem, method, f"{found[path.stem][method]:.3f}", flush=True)  # noqa: T201
    (folder / "truth.json").write_text(json.dumps(found))


def _deformed(task: Any, method: str) -> np.ndarray:
    """Vertices deformed by a method, which has another name in old versions."""
    import sshade

    name, function, vertices, attached = METHODS[method]
    old = getattr(sshade, function, None)
    if old is not None:
        return old(task, vertices=vertices, **({} if attached else {"parts": 0.0})).vertices
    options = {} if attached else {"attachment": 0.0}
    return sshade.deform(task, method=name, vertices=vertices, **options).vertices


def table(folder: Path) -> None:
    """Join the measures of a folder into tracks.csv: a line for each case."""
    import pandas as pd

    solved = json.loads((folder / "truth.json").read_text())
    rows = []
    for name, truth in solved.items():
        with np.load(folder / f"{name}.npz") as arrays:
            facts = json.loads(str(arrays["facts"]))
        groups = facts["groups"]
        hands = [group["turned"] for group in groups if group["landmark"].startswith("hand")]
        rows.append(
            {
                "task": facts["task"],
                "pose": facts["pose"],
                "hands_turned": np.mean(hands),
                **{f"off_{k}": f([group["off"] for group in groups]) for k, f in _SPREAD.items()},
                **{
                    f"residual_{k}": 100 * f([group["residual"] for group in groups])
                    for k, f in _SPREAD.items()
                },
                **truth,
            }
        )
    pd.DataFrame(rows).to_csv(ROWS, index=False, float_format="%.4f", lineterminator="\n")


_SPREAD = {"mean": np.mean, "max": np.max}


def tables() -> dict[str, str]:
    """Return the tables of the page by the names of their blocks, from tracks.csv."""
    import pandas as pd

    from docs.blocks import markdown

    rows = pd.read_csv(ROWS)
    rows["noise"] = rows["task"].str.extract(r"noisy_(\w+)/")[0]
    found = {}
    for block, column in (("noise", "noise"), ("poses", "pose")):
        lines = []
        for value, own in rows.groupby(column, sort=block == "noise"):
            farther = int((own["fast"] > own["paper"]).sum())
            lines.append(
                {
                    column: str(value),
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
        found[block] = markdown(list(lines[0]), [list(line.values()) for line in lines])
    return found


def picture() -> None:
    """Draw the poses of a tuning subject and of a held-out subject, without noise."""
    import pyvista

    from defaust.sources.noisy import NoisyBodies

    source = NoisyBodies(noise=0.0)
    plotter = pyvista.Plotter(shape=(2, 5), off_screen=True, window_size=(1100, 700), border=False)
    for row, subject in enumerate(DRAWN):
        for column, pose in enumerate(source.poses(subject)):
            mesh = source.posed(subject, pose)
            faces = np.column_stack([np.full(mesh.m, 3), mesh.F]).ravel()
            plotter.subplot(row, column)
            plotter.add_mesh(pyvista.PolyData(mesh.V, faces), color="#d0d4dc", smooth_shading=True)
            plotter.add_text(pose.name.replace("_", " "), font_size=8, position="upper_edge")
            centre = np.array([0.0, 0.85, 0.1])
            plotter.camera_position = [tuple(centre + [1.7, 0.6, 4.2]), tuple(centre), (0.0, 1.0, 0.0)]
            plotter.camera.view_angle = 28.0
    plotter.screenshot(PICTURE)
    plotter.close()


def main() -> None:
    """Parse the command line, and run a step."""
    parser = argparse.ArgumentParser(prog="python -m docs.tracks", description=__doc__)
    steps = parser.add_subparsers(dest="step")
    steps.add_parser("picture")
    for step in ("write", "solve", "table"):
        command = steps.add_parser(step)
        command.add_argument("folder", type=Path)
        if step == "write":
            command.add_argument("--data", type=Path, nargs="+", required=True)
            command.add_argument("--subjects", type=int, nargs="+", default=[0, 1, 5, 6])
    args = parser.parse_args()
    if args.step == "write":
        write(args.folder, data=args.data, subjects=args.subjects)
    elif args.step == "solve":
        solve(args.folder)
    elif args.step == "picture":
        picture()
    else:
        if args.step == "table":
            table(args.folder)
        from docs.blocks import fill

        fill(PAGE, tables())


if __name__ == "__main__":
    main()

"""Sequences of poses beside single runs, and poses that drive another mesh: ``sshade-eval sequences``.

Bodies move from rest into a pose. The first table compares :func:`sshade.deform_sequence` with a single run
for each pose: the time of a pose with binding, how much points jump from pose to pose, and the distance from
the ground truth. A jump is the largest second difference in time of a point, in percent of the diagonal; the
handles and the ground truth have one, too. The second table has the errors of poses that drive another body
or animal through marks, beside two baselines: the marks moved by scaled displacements of the source, and no
motion.

examples:
  sshade-eval sequences
  sshade-eval sequences --quick --motions arms_up
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

from eval.publish.markdown import markdown_table
from eval.run.targets import instantiate
from sshade import DeformationTask, Handles, Mesh, deform, deform_sequence, retarget
from sshade.cli.console import progress_bar
from sshade.errors import InputError

MOTIONS = ("arms_up", "leg_lift", "squat", "bend_twist", "hands_on_hips")
#: Number of poses of a motion, and divisions of each triangle, also for --quick.
POSES, LEVEL, QUICK_POSES, QUICK_LEVEL = 24, 2, 12, 0


def second_difference(poses: np.ndarray) -> float:
    """Return the largest second difference in time of a point of poses (k, n, 3)."""
    return float(np.linalg.norm(poses[2:] - 2 * poses[1:-1] + poses[:-2], axis=2).max(initial=0.0))


def distances(V: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return the distances (n,) of vertices from their true places, after the mean translation."""
    return np.linalg.norm(V - truth - (V - truth).mean(axis=0), axis=1)


def measure_motion(motion: Any, methods: Iterable[str]) -> list[list[str]]:
    """Return rows of the first table: each method as a sequence, and in single runs."""
    task, truth, targets = motion.task, motion.truth, motion.targets
    unit, rows = 100 / task.mesh.diagonal, []
    for method in methods:
        for kind in ("sequence", "single runs"):
            begin, followed = perf_counter(), 0
            if kind == "sequence":
                results = list(deform_sequence(task, targets, method=method))
                followed = sum(result.extra["followed"] for result in results)
            else:
                tasks = [replace(task, handles=task.handles.at(target)) for target in targets]
                results = [deform(one, method=method) for one in tasks]
            seconds = (perf_counter() - begin) / len(targets)
            V = np.array([result.vertices for result in results])
            off = unit * np.linalg.norm(V - truth, axis=2).mean()
            jumps = [unit * second_difference(poses) for poses in (targets, truth, V)]
            first = [task.name, f"{task.mesh.n:,}", method, kind, f"{followed} of {len(targets)}"]
            rows.append([*first, f"{seconds:.3f}", *(f"{jump:.2f}" for jump in jumps), f"{off:.2f}"])
    return rows


def measure_drive(drive: Any) -> list[list[str]]:
    """Return rows of the second table: mean and largest errors of each pose."""
    source, target, marks = drive.source, drive.target, drive.marks
    unit, size = 100 / target.diagonal, float(np.sqrt(target.area / source.area))
    begin = perf_counter()
    moved = [result.vertices for result in retarget(source, drive.poses, target, marks=marks)]
    seconds = (perf_counter() - begin) / len(moved)
    rows = []
    for number, name in enumerate(drive.pose_names):
        step = size * (drive.poses[number] - source.V)[marks[:, 0]]
        # Each mark is a group of its own.
        handles = Handles(marks[:, 1], target.V[marks[:, 1]] + step, group=np.arange(len(marks)))
        copied = deform(DeformationTask(name, target, handles)).vertices
        cells = []
        for V in (moved[number], copied, target.V):
            off = unit * distances(V, drive.truth[number])
            cells += [f"{off.mean():.2f}", f"{off.max():.1f}"]
        volume = 100 * (Mesh(moved[number], target.F).volume / target.volume - 1)
        first = [drive.name, name, f"{len(marks)}", f"{target.n:,}"]
        rows.append([*first, f"{seconds:.2f}", *cells, f"{volume:+.2f}"])
    return rows


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = f"poses of the synthetic bodies into which they move (default: {' '.join(MOTIONS)})"
    parser.add_argument("--motions", nargs="+", default=list(MOTIONS), metavar="POSE", help=text)
    text = "methods to compare (default: fast)"
    parser.add_argument("--methods", nargs="+", default=["fast"], metavar="METHOD", help=text)
    text = f"poses of a motion, 3 or more (default: {POSES})"
    parser.add_argument("--poses", type=int, metavar="N", help=text)
    text = f"bodies of 6,890 vertices instead of 110,210, and {QUICK_POSES} poses"
    parser.add_argument("--quick", action="store_true", help=text)


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    count = options.poses or (QUICK_POSES if options.quick else POSES)
    if count < 3:
        raise InputError(f"--poses takes a number from 3, not {count}")
    level, rows = QUICK_LEVEL if options.quick else LEVEL, []
    make = {"_target_": "defaust.tasks.motions.body_motion", "count": count, "level": level}
    motions = [instantiate({**make, "pose": pose}) for pose in options.motions]
    with progress_bar() as progress:
        # Kernels are compiled before the first time is taken.
        first = motions[0]
        list(deform_sequence(first.task, first.targets[:2]))
        for number, motion in enumerate(motions):
            progress("motions", number, len(motions), motion.task.name)
            rows += measure_motion(motion, options.methods)
        drives = instantiate({"_target_": "defaust.tasks.motions.drives"})
        driven = []
        for number, drive in enumerate(drives):
            progress("retargeting", number, len(drives), drive.name)
            driven += measure_drive(drive)
    left = ["motion", "vertices", "method", "run", "followed"]
    header = [*left, "s a pose", "jump of handles (%)", "of truth (%)", "of result (%)", "truth (%)"]
    print("Motions of bodies\n")  # noqa: T201
    print(markdown_table(header, rows, left=left), flush=True)  # noqa: T201
    left = ["from, to", "pose"]
    header = [*left, "marks", "vertices", "s a pose", "mean error (%)", "largest (%)"]
    header += ["displacements: mean (%)", "largest (%) ", "at rest: mean (%)", "largest (%)  ", "volume (%)"]
    print("\nPoses that drive another mesh\n")  # noqa: T201
    print(markdown_table(header, driven, left=left))  # noqa: T201
    return 0

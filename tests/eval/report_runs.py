"""A small experiment with everything that a report shows: results, curves, a failure, a skipped run."""

from pathlib import Path

import numpy as np
from eval_cases import bumpy_task, run

from eval.rows.collect import collect
from eval.rows.frame import write_csv
from sshade.mesh.mesh import Mesh
from sshade.problem.task import TransferTask
from tests.shapes import bumpy

SOURCE = {"_target_": "eval_cases.bumpy_task", "level": 2}
METHODS = {
    "arap": {"_target_": "baselines.arap.arap", "max_iterations": 5, "note": "five <iterations> & no more"},
    "learned": {"_target_": "eval_cases.with_options"},
    "stretching": {"_target_": "eval_cases.stretching", "factor": 1.5},
    "failing": {"_target_": "eval_cases.failing"},
    "missing": {"_target_": "eval_cases.missing_extra"},
}
ANGLES = (10.0, 40.0)


def collected(root: Path) -> Path:
    """Write the rows of a folder of runs to a CSV two folders above it; return the path of the CSV."""
    path = root.parents[1] / f"{root.name}.csv"
    write_csv(path, collect(root))
    return path


def make_runs(folder: Path) -> Path:
    """Run the experiment; return the CSV of its rows. The run folders lie in folder/runs/tiny."""
    root = folder / "runs" / "tiny"
    for angle in ANGLES:
        task = bumpy_task(level=2, angle=angle)
        for method, config in METHODS.items():
            run(task, config, name=method, root=root, source={**SOURCE, "angle": angle})
    return collected(root)


def transfer_task(edit: float, *, truth: bool = True) -> TransferTask:
    """Return the transfer of a half turn to a bumpy sphere that is wider by `edit`."""
    rest = bumpy(2)
    turned = np.array([-1.0, -1.0, 1.0])
    wider = Mesh(rest.V * [1 + edit, 1, 1], rest.F)
    meta = {"edit": f"wider_{edit:g}", "class": "sphere", "source_pose": "turned"}
    true = wider.V * turned if truth else None
    return TransferTask(f"sphere/wider_{edit:g}", wider, rest, rest.V * turned, truth=true, meta=meta)


def make_transfers(folder: Path) -> Path:
    """Run two pose transfers; return the CSV of their rows. The run folders lie in folder/runs/moved."""
    root = folder / "runs" / "moved"
    for edit in (0.1, 0.3):
        source = {"_target_": "report_runs.transfer_task", "edit": edit}
        method = {"_target_": "eval_cases.stretching", "factor": -1.0}
        run(transfer_task(edit), method, name="mirror", root=root, source=source)
    return collected(root)

"""A small experiment with everything that a report tells: results, curves, a failure, a skipped run."""

from __future__ import annotations

from pathlib import Path

from eval_cases import bumpy_task

from eval.collect import collect
from eval.run import run
from eval.store import write_csv

SOURCE = {"_target_": "eval_cases.bumpy_task", "level": 2}
METHODS = {
    "arap": {"_target_": "baselines.arap.arap", "max_iterations": 5, "note": "five <iterations> & no more"},
    "learned": {"_target_": "eval_cases.with_losses"},
    "stretching": {"_target_": "eval_cases.stretching", "factor": 1.5},
    "failing": {"_target_": "eval_cases.failing"},
    "missing": {"_target_": "eval_cases.missing_extra"},
}
ANGLES = (10.0, 40.0)


def make_runs(folder: Path, *, name: str = "tiny") -> Path:
    """Run it; the CSV of its rows. The run folders lie in folder/runs/<name>."""
    root = folder / "runs" / name
    for angle in ANGLES:
        task = bumpy_task(level=2, angle=angle)
        for method, config in METHODS.items():
            run(task, config, name=method, root=root, source={**SOURCE, "angle": angle})
    path = folder / f"{name}.csv"
    write_csv(path, collect(root))
    return path

"""Write the tables of times.md from scaling.csv: ``python -m docs.scaling``.

``--measure`` writes scaling.csv first. It deforms subdivisions of the first body of ``data/defaust_170k``,
which takes a quarter of an hour on a quiet machine with 2 cores. ``--largest`` adds a mesh of 44 million
vertices and needs 16 GiB. Each run is a new process, and its fastest repeat counts. The
column ``others`` says how busy the machine was with other processes.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
from itertools import product
from pathlib import Path
from time import perf_counter, process_time
from typing import NamedTuple

import igl
import numpy as np
import pandas as pd
from scipy.optimize import nnls

from defaust.tasks import load_task
from docs.blocks import circumstances, fill, markdown
from eval.bench.turns import read_machine, used_by_others
from eval.rows.store import Row
from eval.run.environment import environment, process_memory, reset_peak_memory
from eval.run.warmup import warm_up
from sshade import DeformationTask, Handles, Mesh, deform
from sshade.core.console import say

PAGE, ROWS = Path(__file__).with_name("times.md"), Path(__file__).with_suffix(".csv")
#: Times and memory of the command ``sshade deform``.
COMMANDS = Path(__file__).parents[1] / "results" / "tables" / "whole.csv"
#: Bytes per vertex of a closed mesh: a position, and two faces of 64-bit ids.
INPUT = 24 + 2 * 24
#: Repeats of a run; the largest mesh has a single one.
REPEATS = 3
#: Fewest vertices of a run in the fit: smaller meshes are sampled by another algorithm.
FITTED = 1_000_000
#: Fewest vertices of the largest mesh, which is not part of the fit.
LARGE = 30_000_000
#: Units of the model's terms: a million vertices, a thousand samples, a thousand handles.
TERMS = {"constant": None, "vertices": 1e6, "samples": 1e3, "handles": 1e3}
STAGES = ("remesh", "bind", "solve", "carry")


class Run(NamedTuple):
    """Level of subdivision, vertices of the proxy, handles, threads, and the folder of the body."""

    level: int
    samples: int = 12_000
    handles: int = 200
    threads: int = os.cpu_count() or 1
    base: str = "data/defaust_170k"


#: Sizes on one thread and on all threads; then samples and handles varied at 2.7 million vertices.
RUNS = [
    *(Run(level, threads=threads) for level, threads in product((0, 1, 2, 3), {1, Run(0).threads})),
    *(Run(2, samples=samples) for samples in (3_000, 6_000, 24_000, 48_000)),
    *(Run(2, handles=handles) for handles in (1_000, 5_000)),
]
LARGEST = Run(6, base="data/bench/10000")


def task_of(run: Run) -> DeformationTask:
    """Return a subdivided body with random handles that bend it."""
    base = load_task(run.base, subject=0, pose=1).mesh
    index = np.random.default_rng(0).permutation(base.n)[: run.handles]
    V, F = igl.upsample(np.array(base.V), np.array(base.F), run.level)  # keeps the vertices of the body
    extent = np.ptp(V, axis=0)
    along, across = int(np.argmax(extent)), int(np.argmin(extent))
    target = V[index]
    target[:, across] += 0.2 * extent[along] * ((target[:, along] - V[:, along].min()) / extent[along]) ** 2
    for array in (V, F):
        array.setflags(write=False)  # so that Mesh does not copy them
    return DeformationTask("bent body", Mesh(V, F), Handles(index, target))


def measured(run: Run, repeats: int) -> Row:
    """Return the fastest of some repeats of a run, in this process."""
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: run.threads])
    warm_up(deform, {"vertices": 100}, key="scaling", kind=DeformationTask)
    task = task_of(run)
    before = process_memory("VmRSS")
    rows = []
    for _ in range(repeats):
        if before is not None:
            reset_peak_memory()
        machine, begin, cpu = read_machine(), perf_counter(), process_time()
        result = deform(task, vertices=run.samples)
        row = {"seconds": perf_counter() - begin, "cpu": process_time() - cpu}
        row |= {"others": used_by_others(machine, read_machine())}
        row |= {stage: result.seconds[stage] for stage in STAGES}
        row |= {"peak_mib": np.nan if before is None else (process_memory("VmHWM") - before) / 2**20}
        rows.append(row)
    facts = {"vertices": task.mesh.n, "samples": run.samples, "handles": run.handles, "threads": run.threads}
    return facts | min(rows, key=lambda row: row["seconds"])


def measure(*, largest: bool) -> None:
    """Write scaling.csv; without `largest`, keep its largest mesh of the same machine and commit."""
    facts = {name: environment(jobs=1)[name] for name in ("machine", "commit")}
    before = pd.read_csv(ROWS) if ROWS.is_file() else None
    if before is not None:
        before = before[(before["vertices"] > LARGE) & (before[[*facts]] == facts).all(axis=1)]
    rows = []
    for run in RUNS + [LARGEST] * largest:
        say(f"{run}")
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            rows.append(pool.apply(measured, (run, 1 if run is LARGEST else REPEATS)) | facts)
        table = pd.DataFrame(rows)
        if before is not None and not largest:
            table = pd.concat([table, before])
        table.to_csv(ROWS, index=False, float_format="%.5g", lineterminator="\n")


def fit(rows: pd.DataFrame, column: str) -> tuple[dict[str, float], float]:
    """Fit non-negative coefficients by least squares of relative errors; also return the largest error."""
    A = np.stack(
        [np.ones(len(rows)) if unit is None else rows[name] / unit for name, unit in TERMS.items()], 1
    )
    found, _ = nnls(A / rows[column].to_numpy()[:, None], np.ones(len(rows)))
    return dict(zip(TERMS, found, strict=True)), float(np.abs(A @ found / rows[column] - 1).max())


def models(rows: pd.DataFrame) -> dict[str, tuple[dict[str, float], float]]:
    """Return the fits of time, CPU time and memory by their titles."""
    rows = rows[(rows["vertices"] >= FITTED) & (rows["vertices"] < LARGE)]
    threads = rows["threads"].max()
    every = rows[rows["threads"] == threads]
    return {
        f"seconds, {threads} threads": fit(every, "seconds"),
        f"CPU seconds, {threads} threads": fit(every, "cpu"),
        "peak above the input (MiB)": fit(every, "peak_mib"),
    }


def table_of_models(rows: pd.DataFrame) -> str:
    """Return the table of fits, with a prediction for a hundred million vertices."""
    head = ["", "constant", "a million vertices", "a thousand samples", "a thousand handles", "largest error"]
    lines = []
    for name, (found, error) in models(rows).items():
        hundred = found["constant"] + 100 * found["vertices"] + 12 * found["samples"] + 0.2 * found["handles"]
        lines.append([name, *(f"{value:.3g}" for value in found.values()), f"{error:.0%}", f"{hundred:,.0f}"])
    return f"{markdown([*head, '100 million vertices'], lines)}\n\n{circumstances(rows)}"


def table_of_memory(rows: pd.DataFrame) -> str:
    """Return the table of memory: the largest meshes, and predictions for other sizes."""
    largest = rows.loc[rows["vertices"].idxmax()]
    commands = pd.read_csv(COMMANDS)
    command = commands.loc[commands["vertices"].idxmax()]
    taken = {
        "from Python, with the input": (largest, INPUT + largest["peak_mib"] * 2**20 / largest["vertices"]),
        "`sshade deform` of a binary PLY": (command, command["peak_mib"] * 2**20 / command["vertices"]),
    }
    lines = []
    for name, (row, each) in taken.items():
        held, needed = 24 * 2**30 / each / 1e6, 1e8 * each / 2**30
        lines.append([name, f"{row['vertices']:,}", f"{each:.0f}", f"{held:.0f}", f"{needed:.0f}"])
    head = ["", "vertices", "bytes a vertex in all", "million vertices in 24 GiB", "GiB for 100 million"]
    return markdown(head, lines)


def tables(rows: pd.DataFrame) -> dict[str, str]:
    """Return the tables of the page by the names of their blocks."""
    return {"models": table_of_models(rows), "memory": table_of_memory(rows)}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--measure", action="store_true", help="make scaling.csv first")
    parser.add_argument("--largest", action="store_true", help="with 44 million vertices")
    options = parser.parse_args()
    if options.measure:
        measure(largest=options.largest)
    fill(PAGE, tables(pd.read_csv(ROWS)))

"""The cost model and the tables of scaling.md: ``python docs/scaling.py`` makes them from scaling.csv.

With --measure it makes scaling.csv first (a quarter of an hour on a quiet machine of 2 cores), from
subdivisions of the first body of ``data/defaust_170k``; with --largest a mesh of 44 million vertices, too,
which needs 16 GiB. Each run has a process of its own; of its repeats the fastest counts. How busy the machine
was beside stands in the column ``others``.
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
from eval.rows.store import Row
from eval.run.provenance import SOURCES, environment, process_memory
from eval.run.warmup import warm_up
from eval.timing.quiet import between, read_machine
from sshade import DeformationTask, Handles, Mesh, sshade_fast
from sshade.cli.console import say

PAGE, ROWS = Path(__file__).with_suffix(".md"), Path(__file__).with_suffix(".csv")
#: Times and memory of the command ``sshade deform``.
COMMANDS = Path(__file__).parents[1] / "results" / "tables" / "whole.csv"
#: Bytes a vertex of a closed mesh: positions, and twice as many faces of 64-bit ids.
INPUT = 24 + 2 * 24
#: Repeats of a run; the largest has one.
REPEATS = 3
#: Vertices from which on the model is fitted: large meshes are sampled in another way than small ones.
FITTED = 1_000_000
#: The largest mesh has more, and takes no part in the fit.
LARGE = 30_000_000
#: What a term of the model is multiplied with: a million vertices, a thousand samples, a thousand handles.
TERMS = {"constant": None, "vertices": 1e6, "samples": 1e3, "handles": 1e3}
STAGES = ("remesh", "bind", "solve", "carry")


class Run(NamedTuple):
    """A subdivision of a base, the vertices of the proxy, handles, threads."""

    level: int
    samples: int = 12_000
    handles: int = 200
    threads: int = os.cpu_count() or 1
    base: str = "data/defaust_170k"


#: One thing at a time about 2.7 million vertices, and sizes on one thread and on all.
RUNS = [
    *(Run(level, threads=threads) for level, threads in product((0, 1, 2, 3), {1, Run(0).threads})),
    *(Run(2, samples=samples) for samples in (3_000, 6_000, 24_000, 48_000)),
    *(Run(2, handles=handles) for handles in (1_000, 5_000)),
]
LARGEST = Run(6, base="data/bench/10000")


def task_of(run: Run) -> DeformationTask:
    """A body, subdivided, that is bent by some of its vertices."""
    base = load_task(run.base, subject=0, pose=1).mesh
    index = np.random.default_rng(0).permutation(base.n)[: run.handles]
    V, F = np.array(base.V), np.array(base.F)
    for _ in range(run.level):  # keeps the vertices there are
        V, F = igl.upsample(V, F)
    extent = np.ptp(V, axis=0)
    along, across = int(np.argmax(extent)), int(np.argmin(extent))
    target = V[index]
    target[:, across] += 0.2 * extent[along] * ((target[:, along] - V[:, along].min()) / extent[along]) ** 2
    for array in (V, F):
        array.setflags(write=False)  # the mesh needs no copies
    return DeformationTask("bent body", Mesh(V, F), Handles(index, target))


def measured(run: Run, repeats: int) -> Row:
    """The fastest of some repeats of a run, in this process."""
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: run.threads])
    warm_up(sshade_fast, {"vertices": 100}, key="scaling", kind=DeformationTask)
    task = task_of(run)
    before = process_memory("VmRSS")
    rows = []
    for _ in range(repeats):
        if before is not None:
            Path("/proc/self/clear_refs").write_text("5")  # the peak of memory is now what is in use
        machine, begin, cpu = read_machine(), perf_counter(), process_time()
        result = sshade_fast(task, vertices=run.samples)
        row = {"seconds": perf_counter() - begin, "cpu": process_time() - cpu}
        row |= {"others": between(machine, read_machine()).others}
        row |= {stage: result.seconds[stage] for stage in STAGES}
        row |= {"peak_mib": np.nan if before is None else (process_memory("VmHWM") - before) / 2**20}
        rows.append(row)
    facts = {"vertices": task.mesh.n, "samples": run.samples, "handles": run.handles, "threads": run.threads}
    return facts | min(rows, key=lambda row: row["seconds"])


def measure(*, largest: bool) -> None:
    """Make scaling.csv; without `largest` its row of before stays, if it is of this machine and code."""
    facts = {"machine": environment(jobs=1)["machine"], "code": SOURCES}
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
    """The coefficients of the model of a column, none negative, and its largest relative error.

    Least squares of relative errors.
    """
    A = np.stack(
        [np.ones(len(rows)) if unit is None else rows[name] / unit for name, unit in TERMS.items()], 1
    )
    found, _ = nnls(A / rows[column].to_numpy()[:, None], np.ones(len(rows)))
    return dict(zip(TERMS, found, strict=True)), float(np.abs(A @ found / rows[column] - 1).max())


def models(rows: pd.DataFrame) -> dict[str, tuple[dict[str, float], float]]:
    """Fits of the time on one thread and on all, of CPU time, and of memory, by what they are called."""
    rows = rows[(rows["vertices"] >= FITTED) & (rows["vertices"] < LARGE)]
    threads = rows["threads"].max()
    every = rows[rows["threads"] == threads]
    return {
        f"seconds, {threads} threads": fit(every, "seconds"),
        f"CPU seconds, {threads} threads": fit(every, "cpu"),
        "peak above the input (MiB)": fit(every, "peak_mib"),
    }


def table_of_rows(rows: pd.DataFrame) -> str:
    """A line a run."""
    head = [
        "vertices",
        "samples",
        "handles",
        "threads",
        "seconds",
        "CPU s",
        *STAGES,
        "peak (MiB)",
        "bytes a vertex",
    ]
    lines = [
        [f"{row.vertices:,}", f"{row.samples:,}", f"{row.handles:,}", f"{row.threads}", f"{row.seconds:.3g}"]
        + [f"{row.cpu:.3g}", *(f"{getattr(row, stage):.3g}" for stage in STAGES), f"{row.peak_mib:,.0f}"]
        + [f"{row.peak_mib * 2**20 / row.vertices:.0f}"]
        for row in rows.itertuples()
    ]
    (machine,), (code,) = rows["machine"].unique(), rows["code"].unique()
    usual, most = rows["others"].median(), rows["others"].max()
    note = f"Machine: {machine}. Code: version {code[:8]}. "
    note += f"Other processes used {usual:.0%} of it in the median, {most:.0%} at most."
    return f"{_markdown(head, lines)}\n\n{note}"


def table_of_models(rows: pd.DataFrame) -> str:
    """A line a fit, with what it says of a hundred million vertices."""
    head = ["", "constant", "a million vertices", "a thousand samples", "a thousand handles", "largest error"]
    lines = []
    for name, (found, error) in models(rows).items():
        hundred = found["constant"] + 100 * found["vertices"] + 12 * found["samples"] + 0.2 * found["handles"]
        lines.append([name, *(f"{value:.3g}" for value in found.values()), f"{error:.0%}", f"{hundred:,.0f}"])
    return _markdown([*head, "100 million vertices"], lines)


def table_of_memory(rows: pd.DataFrame) -> str:
    """What the largest meshes took, from Python and by the command, and what follows of it for others."""
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
    return _markdown(head, lines)


def _markdown(head: list[str], lines: list[list[str]]) -> str:
    marks = ["---:" if name else "---" for name in head]
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, marks, *lines])


#: By the mark that stands before them in the page.
TABLES = {"runs": table_of_rows, "models": table_of_models, "memory": table_of_memory}


def filled(page: str, rows: pd.DataFrame) -> str:
    """The page with its tables made again; each stands between ``<!-- name -->`` and ``<!-- end -->``."""
    for name, make in TABLES.items():
        head, mark, rest = page.partition(f"<!-- {name} -->\n")
        _, end, rest = rest.partition("\n<!-- end -->")
        if not (mark and end):  # all that follows would be lost
            raise ValueError(f"the page has no block {name}")
        page = head + mark + make(rows) + end + rest
    return page


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--measure", action="store_true", help="make scaling.csv first")
    parser.add_argument("--largest", action="store_true", help="with 44 million vertices")
    options = parser.parse_args()
    if options.measure:
        measure(largest=options.largest)
    PAGE.write_text(filled(PAGE.read_text(), pd.read_csv(ROWS)))

"""Time and memory against the number of vertices, on subdivided bases."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import igl
import numpy as np
import pandas as pd

from eval.publish.plotting import look, new_figure, style
from eval.rows.frame import numbers
from eval.rows.store import Row
from eval.run.provenance import process_memory
from eval.run.targets import instantiate
from eval.timing.cases import TimedMethod
from eval.timing.speed import job_of
from eval.timing.turns import Job, take_turns
from sshade.cli.console import say
from sshade.mesh.mesh import Mesh
from sshade.task import DeformationTask

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: What these rows are of.
KIND = "scaling"
#: The slope of time against vertices is fitted from this size on.
FIT_FROM = 100_000
#: Sizes to measure, each on the subdivision that comes nearest.
SIZES = (10_000, 30_000, 100_000, 300_000, 450_000, 1_000_000, 3_000_000, 5_000_000)
#: Subdivisions of a base at most.
DEEPEST = 5


def time_scaling(
    methods: Sequence[TimedMethod],
    sources: Sequence[dict[str, Any]],
    *,
    rounds: int,
    sizes: Sequence[int] = SIZES,
) -> list[Row]:
    """Time methods on midpoint subdivisions of the bases, and measure their peak memory.

    Each size has a process of its own, in which the methods take turns.

    Parameters
    ----------
    methods : sequence of TimedMethod
    sources : sequence of dict
        Configurations that load the bases: tasks of 10,000 to 30,000 vertices.
    rounds : int
    sizes : sequence of int
        Numbers of vertices; for each the subdivision that comes nearest is taken.

    Returns
    -------
    list of dict
        Rows with ``peak_mib``, the memory in use during a call above that before the first one, what
        the allocator keeps of earlier calls included; None where the system does not tell.

    Raises
    ------
    InputError
        See :func:`eval.timing.turns.take_turns`.
    """
    rows: list[Row] = []
    for n, base, level in nearest([instantiate(source).mesh.n for source in sources], sizes):
        say(f"about {n:,} vertices")
        rows += _in_own_process(_time_size, methods, sources[base], level, rounds)
    return rows


def nearest(bases: Sequence[int], sizes: Sequence[int]) -> list[tuple[int, int, int]]:
    """The subdivisions that come nearest to some sizes, each once: vertices, which of the bases, level.

    Parameters
    ----------
    bases : sequence of int
        Their numbers of vertices.
    sizes : sequence of int
    """
    subdivisions = [(4**level * n, i, level) for i, n in enumerate(bases) for level in range(DEEPEST + 1)]
    return sorted({min(subdivisions, key=lambda case: abs(np.log(case[0] / size))) for size in sizes})


def _in_own_process(function: Callable[..., list[Row]], *arguments: Any) -> list[Row]:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(function, arguments)


def _time_size(methods: Sequence[TimedMethod], source: dict[str, Any], level: int, rounds: int) -> list[Row]:
    task = subdivided(instantiate(source), level)
    jobs = [job_of(method, task) for method in methods]
    before = process_memory("VmRSS")
    jobs = [replace(job, facts=job.facts | {"kind": KIND}, call=_with_peak(job, before)) for job in jobs]
    return take_turns(jobs, rounds=rounds)


def subdivided(task: DeformationTask, level: int) -> DeformationTask:
    """A task on a midpoint subdivision, which keeps the vertices of the base and their handles."""
    V, F = np.array(task.mesh.V), np.array(task.mesh.F)
    for _ in range(level):
        V, F = igl.upsample(V, F)
    return DeformationTask(f"{task.name}, level {level}", Mesh(V, F), task.handles)


def _with_peak(job: Job, before: int | None) -> Callable[[], Row]:
    """The job's call, which measures the peak of memory above the bytes that were in use before."""

    def call() -> Row:
        if before is None:
            return job.call() | {"peak_mib": None}
        Path("/proc/self/clear_refs").write_text("5")  # sets the high-water mark to what is in use now
        row = job.call()
        return row | {"peak_mib": (process_memory("VmHWM") - before) / 2**20}

    return call


def is_scaling(table: pd.DataFrame) -> bool:
    """Whether the lines of a table are of subdivisions."""
    return bool(table["kind"].eq(KIND).all())


def slopes(table: pd.DataFrame) -> dict[str, float]:
    """The log-log slope of median seconds against vertices from :data:`FIT_FROM` on, by method.

    Methods with fewer than two such sizes have none.
    """
    fitted = {}
    for method, own in table[table["vertices"] >= FIT_FROM].groupby("method", sort=False):
        if len(own) > 1:
            x, y = np.log(own["vertices"].astype(float)), np.log(own["seconds.total"].astype(float))
            fitted[str(method)] = float(np.polyfit(x, y, 1)[0])
    return fitted


@style()
def draw_scaling(table: pd.DataFrame) -> Figure:
    """Time, and memory where it is known, against vertices."""
    figure = new_figure(9, 3.6)
    left, right = figure.subplots(1, 2)
    slope = slopes(table)
    looks = look(dict.fromkeys(table["method"]))
    for method, own in table.groupby("method", sort=False):
        n, seconds = numbers(own, "vertices"), numbers(own, "seconds.total")
        label = f"{method}, slope {slope[method]:.2f}" if method in slope else method
        left.loglog(n, seconds, linewidth=1.2, markersize=4, label=label, **looks[method])
        right.semilogx(
            n,
            numbers(own, "peak_mib") * 2**20 / n,
            linewidth=1.2,
            markersize=4,
            label=method,
            **looks[method],
        )
    left.set(xlabel="vertices", ylabel="seconds", title=f"time; slopes from {FIT_FROM:,} vertices on")
    right.set(xlabel="vertices", ylabel="bytes a vertex", title="peak memory above the input", ylim=(0, None))
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend()
    return figure

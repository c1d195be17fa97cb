"""Time and memory against the number of vertices, on subdivided bases."""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import igl
import numpy as np

from eval.publish.plotting import PALETTE, new_figure, save, style
from eval.run.provenance import process_memory
from eval.timing.timing import say
from sshade.io.handles import read_handles
from sshade.io.meshes import read_mesh
from sshade.mesh.mesh import Mesh
from sshade.pipeline.deform import deform
from sshade.task import DeformationTask

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: The slope of time against vertices is fitted from this size on.
FIT_FROM = 100_000
#: Sizes to measure, each on the subdivision that comes nearest.
SIZES = (10_000, 30_000, 100_000, 300_000, 450_000, 1_000_000, 3_000_000, 5_000_000)
#: Subdivisions of a base at most.
DEEPEST = 5


def scaling(
    bases: Sequence[Path],
    handles: Path,
    *,
    vertices: int,
    repeats: int,
    sizes: Sequence[int] = SIZES,
    plot: Path | None = None,
) -> None:
    """Print time and peak memory of one sampling on midpoint subdivisions of the bases.

    Every size runs in a process of its own; reading, subdividing, validation
    and compilation are outside the clock.

    Parameters
    ----------
    bases : sequence of path
        Meshes of 10,000 to 30,000 vertices, which the handles fit by position.
    handles : path
    vertices : int
        Proxy vertices.
    repeats : int
    sizes : sequence of int
        Numbers of vertices; for each the subdivision that comes nearest is taken.
    plot : path, optional
        Picture to write.
    """
    counts = [read_mesh(base).n for base in bases]
    subdivisions = [
        (4**level * n, base, level)
        for n, base in zip(counts, bases, strict=True)
        for level in range(DEEPEST + 1)
    ]
    cases = {min(subdivisions, key=lambda case: abs(np.log(case[0] / size))) for size in sizes}
    say(f"{'vertices':>10}{'seconds':>10}{'us/vertex':>11}{'MiB':>8}{'bytes/vertex':>14}")
    rows = []
    context = multiprocessing.get_context("spawn")
    for _, base, level in sorted(cases):
        with context.Pool(1) as pool:
            n, seconds, peak = pool.apply(_measure, (base, handles, level, vertices, repeats))
        rows.append((n, seconds, peak))
        say(f"{n:10d}{seconds:10.3f}{1e6 * seconds / n:11.3f}{peak / 2**20:8.0f}{peak / n:14.0f}")
    fitted = np.log([(n, seconds) for n, seconds, _ in rows if n >= FIT_FROM]).reshape(-1, 2)
    slope = float(np.polyfit(*fitted.T, 1)[0]) if len(fitted) > 1 else np.nan
    say(f"log-log slope of time against vertices from {FIT_FROM} on: {slope:.2f}")
    if plot is not None:
        save(_figure(rows, slope), plot)


def _measure(base: Path, handles: Path, level: int, vertices: int, repeats: int) -> tuple[int, float, int]:
    """Vertices, median seconds, and peak bytes above what the task takes."""
    mesh = read_mesh(base)
    held = read_handles(handles, mesh)  # midpoint subdivision keeps the ids of the base
    small = DeformationTask("base", mesh, held)
    count = min(vertices, mesh.n // 2)
    deform(small, vertices=count, samplings=1)  # compiles
    for _ in range(level):
        mesh = Mesh(*igl.upsample(np.array(mesh.V), np.array(mesh.F)))
    task = DeformationTask("subdivided", mesh, held)
    Path("/proc/self/clear_refs").write_text("5")  # sets the high-water mark to the memory in use now (Linux)
    before = process_memory("VmRSS")
    seconds = []
    for _ in range(repeats):
        begin = perf_counter()
        deform(task, vertices=count, samplings=1)
        seconds.append(perf_counter() - begin)
    return mesh.n, float(np.median(seconds)), process_memory("VmHWM") - before


@style()
def _figure(rows: list[tuple[int, float, int]], slope: float) -> Figure:
    n, seconds, peak = (np.array(column, dtype=float) for column in zip(*rows, strict=True))
    figure = new_figure(9, 3.6)
    left, right = figure.subplots(1, 2)
    left.loglog(n, seconds, "o-", color=PALETTE[0])
    anchor = n >= FIT_FROM
    if anchor.any():
        left.loglog(n, seconds[anchor][0] * n / n[anchor][0], ":", color="grey", label="linear")
        left.legend()
    left.set(xlabel="vertices", ylabel="seconds", title=f"one sampling, slope {slope:.2f}")
    right.semilogx(n, peak / n, "o-", color=PALETTE[3])
    right.set(xlabel="vertices", ylabel="bytes a vertex", title="peak memory above the input", ylim=(0, None))
    for axes in (left, right):
        axes.grid(alpha=0.3)
    return figure

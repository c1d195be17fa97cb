"""``python -m eval.bench``: how much faster than full-resolution Elastic?"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np

from eval.metrics import measure
from sshade.coarse import libigl_arap
from sshade.console import run_command
from sshade.handlesio import read_handles
from sshade.meshio import read_mesh
from sshade.pipeline import deform
from sshade.task import DeformationResult, DeformationTask

#: Iterations that Elastic is compared at: the paper's cutoff.
ITERATIONS = 1000
#: Metrics printed for the quality of both.
QUALITY = ("volume", "area", "edge", "angle", "handle")

DESCRIPTION = """\
Time SShaDe against libigl's Elastic on one mesh with handles, side by side in one process:
medians over repeats that take turns, compilation and input outside the clock.

Elastic is timed over a block of iterations and extrapolated to 1000; with --full it also
runs to the end, under the tables' stopping rule and to 1000 iterations, and the quality of
the results is compared.

example:
  defaust build source=synthetic out=data/defaust_170k subjects=[0] target_vertices=170000
  python -m eval.bench data/defaust_170k/subject_00/rest.ply data/defaust_170k/subject_00/pose_1.json
"""


@dataclass
class Timing:
    """Wall-clock seconds of the repeats of one configuration, and the last result."""

    seconds: list[float] = field(default_factory=list)
    stages: list[dict[str, float]] = field(default_factory=list)
    result: DeformationResult | None = None

    def add(self, run: Callable[[], DeformationResult]) -> None:
        """Run once on the clock."""
        begin = perf_counter()
        self.result = run()
        self.seconds.append(perf_counter() - begin)
        self.stages.append(dict(self.result.seconds))

    @property
    def median(self) -> float:
        """Median wall-clock seconds."""
        return float(np.median(self.seconds))

    def stage(self, name: str) -> float:
        """Median seconds of a stage, summed over samplings."""
        return float(np.median([stages[name] for stages in self.stages]))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m eval.bench",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("mesh", type=Path, metavar="MESH")
    parser.add_argument("handles", type=Path, metavar="HANDLES")
    parser.add_argument("--vertices", type=int, default=6000, metavar="N", help="proxy vertices")
    parser.add_argument("--samplings", type=int, nargs="+", default=(5, 1), metavar="K")
    parser.add_argument("--repeats", type=int, default=5, metavar="R")
    parser.add_argument("--block", type=int, default=10, metavar="I", help="Elastic iterations a repeat")
    parser.add_argument("--full", action="store_true", help="also run Elastic to its end (minutes)")
    return run_command(lambda: _bench(parser.parse_args(argv)))


def _bench(arguments: argparse.Namespace) -> int:
    mesh = read_mesh(arguments.mesh)
    task = DeformationTask(arguments.mesh.stem, mesh, read_handles(arguments.handles, mesh))
    _say(f"{arguments.mesh}: {mesh.n} vertices, {len(task.handles)} handles; {os.cpu_count()} processors")
    ours = {
        f"sshade, {k} sampling{'s' if k > 1 else ''}": partial(
            deform, task, vertices=arguments.vertices, samplings=k, seed=0
        )
        for k in arguments.samplings
    }
    elastic = partial(libigl_arap, task, tolerance=0.0, max_iterations=arguments.block)
    next(iter(ours.values()))()  # compiles
    timings = {name: Timing() for name in ours}
    block = Timing()
    for _ in range(arguments.repeats):
        block.add(elastic)
        for name, run in ours.items():
            timings[name].add(run)

    iteration = block.stage("solve") / arguments.block
    whole = block.stage("precompute") + ITERATIONS * iteration
    _say(
        f"elastic (libigl): precomputation {block.stage('precompute'):.2f} s, {iteration:.4f} s "
        f"an iteration; {ITERATIONS} iterations, extrapolated from {arguments.repeats} x {arguments.block}: "
        f"{whole:.1f} s"
    )
    for name, timing in timings.items():
        assert timing.result is not None
        stages = ", ".join(f"{stage} {timing.stage(stage):.3f}" for stage in timing.stages[0])
        _say(f"{name}: {timing.median:.3f} s ({stages}; summed over samplings)")
        _say(
            f"  {timing.result.iterations:.0f} iterations in the mean, engine {timing.result.extra['engine']}"
        )
        _say(f"  speed-up over {ITERATIONS} iterations of elastic: {whole / timing.median:.0f}x")
    if arguments.full:
        _full(task, timings)
    return 0


def _full(task: DeformationTask, timings: dict[str, Timing]) -> None:
    """Elastic to its end, once; ratios and quality."""
    results = {name: timing.result for name, timing in timings.items()}
    for name, tolerance in (("stopping rule", 1e-5), (f"{ITERATIONS} iterations", 0.0)):
        timing = Timing()
        timing.add(partial(libigl_arap, task, tolerance=tolerance, max_iterations=ITERATIONS))
        assert timing.result is not None
        results[f"elastic, {name}"] = timing.result
        ratios = ", ".join(f"{timing.median / t.median:.0f}x {own}" for own, t in timings.items())
        _say(
            f"elastic, {name}: {timing.median:.1f} s, {timing.result.iterations} iterations, "
            f"residual {timing.result.extra['residual']:.1e}; {ratios}"
        )
        if timing.result.iterations == ITERATIONS:
            results[f"elastic, {ITERATIONS} iterations"] = timing.result
            break  # the rule never fired: both runs are the same
    _say(f"{'':28}" + "".join(f"{name:>12}" for name in QUALITY))
    for name, result in results.items():
        assert result is not None
        values = measure(task, result.vertices)
        cells = ("n/a" if values[metric] is None else f"{values[metric]:.4f}" for metric in QUALITY)
        _say(f"{name:28}" + "".join(f"{cell:>12}" for cell in cells))


def _say(text: str) -> None:
    print(text, flush=True)  # noqa: T201


if __name__ == "__main__":
    sys.exit(main())

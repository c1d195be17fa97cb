"""End to end and stage by stage, against libigl's Elastic and a sparse Cholesky factorisation."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.sparse import csr_array

from eval.metrics import measure
from eval.run.targets import locate
from eval.timing.timing import Timing, say, take_turns
from sshade.pipeline.deform import deform
from sshade.pipeline.fast import sshade_fast
from sshade.pipeline.fine import sshade_fine
from sshade.sampling.remesh import remesh
from sshade.solver.cotangents import edge_weights, half_cotangents, laplacian_matrix
from sshade.solver.factorisation import Factorisation
from sshade.task import DeformationTask

#: Iterations that Elastic is compared at: the paper's cutoff.
ITERATIONS = 1000
#: libigl's spokes-and-rims ARAP.
ELASTIC = "baselines.arap.elastic"
#: Metrics printed for the quality of both.
QUALITY = ("volume", "area", "edge", "angle", "handle")


def speed(
    task: DeformationTask, *, vertices: int, samplings: Sequence[int], repeats: int, block: int, full: bool
) -> None:
    """Print the times of SShaDe, its remeshing and one factorisation beside Elastic's iterations.

    Parameters
    ----------
    task : DeformationTask
    vertices : int
        Proxy vertices.
    samplings : sequence of int
        Numbers of samplings to time.
    repeats : int
    block : int
        Elastic iterations a repeat; 1000 are extrapolated from them.
    full : bool
        Run Elastic to its end as well, and compare the results' quality.
    """
    ours = {}
    for k in samplings:
        ours[_name(k)] = partial(deform, task, vertices=vertices, samplings=k)
        if k > 1:
            ours[f"{_name(k)}, warm start"] = partial(
                deform, task, vertices=vertices, samplings=k, warm_start=True
            )
    ours["sshade_fast"] = partial(sshade_fast, task, vertices=vertices)
    ours["sshade_fine"] = partial(sshade_fine, task, vertices=vertices)
    elastic = partial(locate(ELASTIC), task, tolerance=0.0, max_iterations=block)
    remeshing = partial(remesh, task.mesh, vertices, first=task.handles.index, seed=(0, 0))
    factorisation = partial(Factorisation, _matrix(task))
    for run in (*ours.values(), remeshing):  # compiles
        run()
    timings = take_turns({"elastic": elastic, **ours, "remesh": remeshing}, repeats)
    timings |= take_turns({"factorisation": factorisation}, min(repeats, 3))

    one = timings["elastic"].stage("solve") / block
    whole = timings["elastic"].stage("precompute") + ITERATIONS * one
    say(
        f"elastic (libigl): precomputation {timings['elastic'].stage('precompute'):.2f} s, {one:.4f} s an "
        f"iteration; {ITERATIONS} iterations, extrapolated from {repeats} x {block}: {whole:.1f} s"
    )
    for name in ours:
        timing = timings[name]
        stages = ", ".join(f"{stage} {timing.stage(stage):.3f}" for stage in timing.stages[0])
        say(
            f"{name}: {timing.median:.3f} s, {whole / timing.median:.0f}x faster than {ITERATIONS} "
            f"iterations of elastic\n  stages, which may overlap in time: {stages}\n"
            f"  {timing.result.iterations:.0f} iterations"
        )
    remesh_time = timings["remesh"].median
    say(f"remesh (one thread): {remesh_time:.3f} s = {remesh_time / one:.2f} iterations of elastic")
    fastest, factored = _name(min(samplings)), timings["factorisation"].median
    say(
        f"one full-resolution Cholesky factorisation: superlu {factored:.2f} s; {fastest} takes "
        f"{timings[fastest].median / factored:.2f} of that"
    )
    _say_warm_start(task, timings)
    if full:
        _full(task, {name: timings[name] for name in ours})


def _name(samplings: int) -> str:
    return f"sshade, {samplings} sampling{'s' if samplings > 1 else ''}"


def _matrix(task: DeformationTask) -> csr_array:
    """The full-resolution system of ARAP: L_ff, the Laplacian between free vertices."""
    mesh = task.mesh
    laplacian = laplacian_matrix(mesh.n, *edge_weights(mesh, half_cotangents(mesh)))
    free = np.setdiff1d(np.arange(mesh.n), task.handles.index)
    return laplacian[free][:, free]


def _say_warm_start(task: DeformationTask, timings: dict[str, Timing]) -> None:
    """How far a warm start of the later samplings moves the result."""
    for name, timing in timings.items():
        if name.endswith(", warm start"):
            cold = timings[name.removesuffix(", warm start")].result
            gap = np.linalg.norm(timing.result.vertices - cold.vertices, axis=1) / task.mesh.diagonal
            say(
                f"{name} moves the result by {gap.max():.1e} of the diagonal at most, "
                f"{gap.mean():.1e} in the mean"
            )


def _full(task: DeformationTask, ours: dict[str, Timing]) -> None:
    """Run Elastic to its end, once; print ratios of time and the quality of all results."""
    results = {name: timing.result for name, timing in ours.items()}
    for name, tolerance in (("stopping rule", 1e-5), (f"{ITERATIONS} iterations", 0.0)):
        run = partial(locate(ELASTIC), task, tolerance=tolerance, max_iterations=ITERATIONS)
        timing = take_turns({name: run}, 1)[name]
        results[f"elastic, {name}"] = timing.result
        ratios = ", ".join(f"{timing.median / t.median:.0f}x {own}" for own, t in ours.items())
        say(
            f"elastic, {name}: {timing.median:.1f} s, {timing.result.iterations} iterations, "
            f"residual {timing.result.extra['residual']:.1e}; {ratios}"
        )
        if timing.result.iterations == ITERATIONS:
            break  # the rule never fired: a second run would be the same
    say(f"{'':32}" + "".join(f"{name:>10}" for name in QUALITY))
    for name, result in results.items():
        values = measure(task, result.vertices)
        cells = ("n/a" if values[metric] is None else f"{values[metric]:.4f}" for metric in QUALITY)
        say(f"{name:32}" + "".join(f"{cell:>10}" for cell in cells))

"""Measures, methods of others, datasets, edits, tasks, tables, and drags that are timed."""

from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from itertools import accumulate, count
from pathlib import Path
from unittest import mock

import numpy as np

from baselines.ablations.replaced import paper_with, transfer_with
from baselines.accelerated import accelerated_arap, local_global
from baselines.arap import arap, elastic
from baselines.arap_sr.arap_sr import arap_sr
from baselines.deformation_fields import deformation_field
from baselines.deformation_graph.deformation_graph import deformation_graph
from baselines.rbf import rbf
from baselines.smooth_arap import smooth_arap
from baselines.vertex_frames import transfer
from baselines.volumetric.lattice_arap import lattice_arap
from defaust.build.dataset import build
from defaust.edits import EDITS
from defaust.tasks import list_tasks, load_task
from defaust.tasks.hairpin import hairpin_task
from eval.bench.cases import moved
from eval.bench.drags import drag
from eval.metrics import measure
from eval.publish.figures import time_and_truth
from eval.publish.report import headline
from eval.publish.summary import make_table
from eval.publish.tables import FORMATS
from eval.rows.collect import Experiment
from eval.rows.frame import newest, records
from eval.rows.store import write_run
from sshade import DeformationTask, Mesh, TransferTask, deform
from tests.defaust.toy import OPTIONS, Balls
from tests.eval.eval_rows import frame, lost, row
from tests.files import contents
from tests.record.scenes.scene import Values, outcomes, patches, scene
from tests.shapes import bent, beside, bumpy, end_handles, icosphere, shifted, strip

#: Modules that time their parts.
TIMED = [f"sshade.{name}" for name in ("proxy.bind", "proxy.binding", "solver.local_global")]
TIMED += [f"sshade.method.{name}" for name in ("assembly", "bound", "piece", "polish", "transfer")]
TIMED += ["sshade.interpolation.dense_handles", "baselines.stopwatch", "baselines.accelerated"]


@scene
def measures() -> Values:
    mesh = bumpy(3)
    own = end_handles(mesh.V, count=6, shift=[0.2, 0, 0])
    V = bent(mesh.V, 0.4)
    V[5] += 1.5
    yield "of a body", measure(DeformationTask("t", mesh, own, truth=bent(mesh.V)), V)
    sheet = strip(12, 4)
    flat = DeformationTask("t", sheet, end_handles(sheet.V, axis=0))
    yield "of a sheet", measure(flat, bent(sheet.V))
    turned = np.where(np.arange(mesh.m)[:, None] % 9, mesh.F, mesh.F[:, ::-1])
    yield "of turned faces", measure(DeformationTask("t", Mesh(mesh.V, turned), own), V)
    yield "of a transfer", measure(TransferTask("t", mesh, mesh, mesh.V, truth=bent(mesh.V)), V)
    yield "at rest", measure(TransferTask("t", mesh, mesh, mesh.V), mesh.V)


@outcomes
def baselines() -> Values:
    mesh = bumpy(3)
    task = patches(mesh, 8)
    guessed = replace(task, guess=bent(mesh.V))
    for name, (method, of) in {
        "arap": (partial(arap, max_iterations=6), task),
        "elastic": (partial(elastic, max_iterations=6, start="rigid"), task),
        "accelerated": (partial(local_global, max_iterations=30), task),
        "guessed": (partial(accelerated_arap, volume=np.inf, max_iterations=2), guessed),
        "arap_sr": (partial(arap_sr, max_iterations=6), task),
        "deformation_graph": (deformation_graph, task),
        "harmonic": (partial(deformation_field, start="rigid"), task),
        "biharmonic": (partial(deformation_field, order=2), task),
        "rbf": (rbf, task),
        "smooth_arap": (partial(smooth_arap, max_iterations=3, start="rigid"), task),
        "smooth_arap guessed": (partial(smooth_arap, max_iterations=2), guessed),
        "lattice_arap": (partial(lattice_arap, cells=10, max_iterations=4), task),
        "paper_with": (
            partial(paper_with, vertices=60, samplings=2, projection="surface", handle_mode="nearest"),
            task,
        ),
    }.items():
        yield name, method(of, seed=0)
    with mock.patch("baselines.arap_sr.arap_sr.RISE", 0.999):  # so that the acceleration begins anew
        yield "restarts", arap_sr(patches(mesh, 8, turn=3.0), accelerate=True, max_iterations=15)
    edited = TransferTask("t", Mesh(1.1 * mesh.V, mesh.F), mesh, bent(mesh.V))
    yield "vertex_frames", transfer(edited)
    yield "transfer_with", transfer_with(edited, frames="affine", residual=True, vertices=60, samplings=2)
    yield "hairpin", deform(hairpin_task(gap=0.05, angle=20.0, around=20), vertices=200)
    parts = DeformationTask("t", beside(mesh, shifted(icosphere(2), [5, 0, 0])), task.handles)
    yield "free part", accelerated_arap(parts, max_iterations=4)
    # A drag leaves the shapes of earlier steps as they were. Its steps end elsewhere on other processors.
    with mock.patch("eval.bench.drags.perf_counter", accumulate(count()).__next__):
        row = drag(task, {"vertices": 60, "max_iterations": 8})
    most = {"drag.last": 0.6, "drag.settled": 0.2, "drag.return": 0.05}
    yield "drag", row | {name: row[name] < most[name] for name in most}
    yield (
        "clock",
        [row[f"seconds.{name}"] for name in ("bind", "first", "step", "step_95", "settle", "rebind")],
    )
    yield "moved by a hair", moved(replace(task, truth=mesh.V), 3)


@scene
def memory_of_a_graph() -> Values:
    yield "deformation_graph", deformation_graph(patches(bumpy(5), 40), nodes=2000, max_iterations=1)


@outcomes
def tasks() -> Values:
    build(Balls(subjects=(0, 1)), Path("balls"), options=OPTIONS, workers=1)
    yield (
        "tasks",
        [list(map(list, list_tasks("balls", **of))) for of in ({}, {"subjects": [1], "poses": [2]})],
    )
    for options in (
        {},
        {"raw": True},
        {"resolution": "low"},
        {"handles": "points"},
        {"handles": "regions"},
        {"edit": "inflate"},
        {"edit": "unedited", "resolution": "low"},
    ):
        yield str(options), load_task("balls", subject=1, pose=1, **options)
    with mock.patch("defaust.tasks.load._truth", None):  # which takes seconds for a large mesh
        yield "untrue", load_task("balls", subject=1, pose=1, truth=False)


@scene
def edits() -> Values:
    mesh = bumpy(4)
    for name, edit in EDITS.items():
        yield name, edit(mesh)


@outcomes
def tables() -> Values:
    """Rows of two subjects of a table by hand, of methods with failures, seeds, versions and no truth."""

    def on(method: str, *truths: float | None, **changes) -> list:
        return [
            lost(method, f"s{k}/p", status="timeout")
            if truth is None
            else row(method, f"s{k}/p", metric__truth_distance=truth, **changes)
            for k, truth in enumerate(truths)
        ]

    no = {"env__commit": None}
    both = [*on("elastic", 4, 5, 6, 7, 8, 9), *on("b<_|", 1, 2, 3, 4, 5, None, env__jobs=2)]
    true = on("true pose", 0, 0, 0, 0, 0, 0, method__target="eval.metrics.measure")
    rows = {
        "two methods": [*both, *true],
        "few cases": [*both, *on("few", 1, None, None)],
        "no truth": [row("a"), row("b", "t2", metric__volume=None), lost("c")],
        "seeds": [*on("s", 1, 2, **no), *on("s", 2, 4, seed=1, **no), *on("a", 3, 3, **no)],
        "versions": [row("fast", method__version=1), row("mine", method__method="fast"), row("new")],
        "settings": [
            row("a", method__start="rest"),
            row("b", method__start="rigid", method__note="one\ntwo"),
            row("c", method__start="rigid"),
        ],
        "reasons": [
            *on("a", *range(6)),
            *(lost("b", f"s{k}/p", reason="often " * 40 if k else "once") for k in range(5)),
            row("b", "s5/p"),
        ],
        "builds": [row("a"), row("a", task__checksum="d", seed=1), row("b")],
    }
    for name, own in rows.items():
        given = newest(frame(*own))
        table = make_table(given, title=name)
        for text_of in FORMATS.values():
            yield name, text_of(table).splitlines()
        yield f"{name}, headline", headline(table, given) or {}
        yield f"{name}, chart", time_and_truth(given)
        for case in Experiment(name, given, Path()).cases():
            yield f"{name}, case", [f"{r['method.name']} {r['task.name']} {r['seed']}" for r in case]
        yield f"{name}, rows", len(records(given))
    write_run("run", row(), vertices=np.eye(3))
    write_run("run", lost("a"))
    yield "files of a run that failed after one with a result", sorted(contents("run"))


@outcomes
def clocks() -> Values:
    """The times of results, by a clock that ticks faster and faster; the meshes are too small for threads."""
    body = bumpy(3)
    small = DeformationTask("t", body, end_handles(body.V, count=8, shift=[0.3, 0, 0.2]))
    edited = TransferTask("t", Mesh(1.1 * body.V, body.F), body, bent(body.V))
    clock = accumulate(count()).__next__
    with ExitStack() as patched:
        for module in TIMED:
            patched.enter_context(mock.patch(f"{module}.perf_counter", clock))
        for method in ("fast", "fine", "paper"):
            yield method, list(deform(small, method=method, vertices=100, workers=1).seconds.items())
        yield "interpolate", list(deform(small, method="interpolate").seconds.items())
        for method in (arap, elastic, accelerated_arap, deformation_field, rbf):
            yield method.__name__, list(method(small).seconds.items())
        yield "transfer", list(transfer_with(edited, vertices=60, samplings=2, workers=1).seconds.items())

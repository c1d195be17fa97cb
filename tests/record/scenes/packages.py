"""Measures, methods of others, and tasks."""

from functools import partial

from baselines.accelerated import local_global
from baselines.arap import arap, elastic
from baselines.arap_sr.arap_sr import arap_sr
from baselines.deformation_graph.deformation_graph import deformation_graph
from defaust.tasks.hairpin import hairpin_task
from eval.metrics import measure
from sshade import (
    DeformationTask,
    deform,
)
from tests.record.scenes.scene import Values, patches, scene
from tests.shapes import bent, bumpy, end_handles, strip


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


@scene
def baselines() -> Values:
    task = patches(bumpy(3), 8)
    for name, method in {
        "arap": partial(arap, max_iterations=6),
        "elastic": partial(elastic, max_iterations=6),
        "accelerated": partial(local_global, max_iterations=30),
        "arap_sr": partial(arap_sr, max_iterations=6),
        "deformation_graph": deformation_graph,
    }.items():
        yield name, method(task, seed=0)
    yield "hairpin", deform(hairpin_task(gap=0.05, angle=20.0, around=20), vertices=200)

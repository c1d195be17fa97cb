import weakref

import numpy as np
import pytest

from baselines.accelerated import local_global
from sshade import DeformationTask, Handles, Mesh
from sshade.method import polish
from sshade.problem.options import PRESETS, SOLVER
from sshade.regions.handle_regions import edge_vertices
from tests.shapes import bumpy, end_handles
from tests.sshade.method.calls import fast, fine

POLISH = {name: getattr(PRESETS["fine"], name) for name in SOLVER}


@pytest.fixture(scope="module")
def task() -> DeformationTask:
    """A bumpy ball with its cap pushed aside."""
    mesh = bumpy(4)
    return DeformationTask("cap", mesh, end_handles(mesh.V, share=0.075, shift=(0.5, 0.1, 0.2)))


@pytest.mark.parametrize(("method", "area"), [(fast, 8e-3), (fine, 1e-6)])
def test_volume_area_and_handles_are_kept(task, method, area):
    """`fast` constrains the area of the proxy only, so the area of the mesh is less exact."""
    result = method(task, vertices=600, area=np.inf)
    after, facts = Mesh(result.vertices, task.mesh.F), result.facts
    assert after.volume == pytest.approx(task.mesh.volume, rel=1e-6)
    assert after.area == pytest.approx(task.mesh.area, rel=area)
    gap = np.abs(result.vertices[task.handles.index] - task.handles.target).max()
    assert gap < 1e-12 * task.mesh.diagonal if method is fast else gap == 0
    assert facts.volume_constraint == facts.area_constraint == "exact"
    assert facts.volume_error < 1e-6 and facts.area_error < 1e-6
    assert method is fast or facts.proxy_iterations > 0 and result.iterations <= 60


@pytest.mark.parametrize("volume", [0.0, np.inf])
def test_fine_ends_in_the_minimum_at_full_resolution(task, volume):
    """A converged polish ends in the minimum that the solver finds from the rest shape.

    `fine` turns the surface beside regions after the polish. Here only the edges of regions are handles.
    """
    edge = np.isin(task.handles.index, edge_vertices(task.mesh, task.handles.index))
    handles = Handles(task.handles.index[edge], task.handles.target[edge])
    task = DeformationTask("edges", task.mesh, handles)
    options = {"volume": volume, "area": 0.0, "tolerance": 1e-7}
    result = fine(task, vertices=600, polish_iterations=3000, joints=0, **options)
    plain = local_global(task, **{**POLISH, **options, "max_iterations": 5000})
    assert result.converged and plain.converged
    assert result.facts.energy == pytest.approx(plain.extra["energy"], rel=1e-5)
    assert np.abs(result.vertices - plain.vertices).max() < 1e-3 * task.mesh.diagonal


def test_a_polish_frees_the_result_of_the_proxy(task, monkeypatch):
    def solved(*given, start, **options):
        rest, last = start.copy(), weakref.ref(start)
        del start
        left.append(last())
        return solve(*given, start=rest, **options)

    left, solve = [], polish.solve
    monkeypatch.setattr(polish, "solve", solved)
    fine(task, vertices=100, polish_iterations=1)
    assert left[0] is None


@pytest.mark.parametrize("most", [50, 0])
def test_stages_are_reported_in_order_each_to_its_end(task, most):
    stages: dict[str, tuple[int, int]] = {}

    def progress(stage, done, total, _=""):
        stages[stage] = done, total

    result = fine(task, vertices=600, polish_iterations=most, progress=progress)
    assert (result.iterations == 0 and result.converged is None) == (most == 0)
    assert result.facts.proxy_iterations > 0  # of the proxy, not of the polish
    assert list(stages) == ["proxy", "polish", "regions"]
    assert all(done == total for done, total in stages.values())

"""The number of vertices of a proxy follows the same rule in all methods and commands."""

import tracemalloc

import numpy as np
import pytest

from baselines.deformation_graph.deformation_graph import deformation_graph
from sshade import DeformationTask, Deformer, bind, transfer_pose
from sshade.proxy.bind import proxy_vertices, shared_vertices
from tests.shapes import bent, bumpy, end_handles
from tests.sshade.method.calls import fast, fine, paper

BODY = bumpy(3)
TASK = DeformationTask("body", BODY, end_handles(BODY.V, share=0.02, shift=[0, 0, 0.2]))


def test_a_quarter_of_the_mesh_at_most_and_room_for_the_handles():
    """And no more than the mesh has. So few that the sampling refuses them stay so few."""
    n = [24_000, 23_999, 4802, 1000, 302, 4, 5000]
    asked, handles = [6000] * 6 + [10], [300] * 5 + [0, 300]
    assert list(map(proxy_vertices, asked, n, handles)) == [6000, 5999, 1200, 304, 302, 4, 10]


@pytest.mark.parametrize(
    ("asked", "area", "shares"),
    [
        (100, [1, 3, 6], [10, 30, 60]),
        (300, [1, 3, 6], [33, 70, 197]),  # the second gets its maximum, the others the rest
        (60, [1, 1, 4], [10, 10, 40]),
        (60, [1, 0.2, 4], [10, 10, 40]),  # the second needs more than its portion
        (1000, [1, 3, 6], [40, 70, 250]),
        (5, [1, 3, 6], [2, 10, 4]),
        (100, [0, 0, 1], [2, 10, 88]),
        (100, [1, 0, 0], [40, 10, 4]),
    ],
)
def test_components_share_by_area_what_they_can_use(asked, area, shares):
    least, most = np.array([2, 10, 4]), np.array([40, 70, 250])
    assert shared_vertices(asked, np.array(area, dtype=float), least, most).tolist() == shares


@pytest.mark.parametrize("method", [paper, fast, fine])
def test_every_method_samples_a_quarter_and_says_so(method):
    by_default, asked, fewer = (method(TASK, **more) for more in ({}, {"vertices": 160}, {"vertices": 100}))
    assert by_default.facts.samples == asked.facts.samples == BODY.n // 4 == 160
    assert np.array_equal(by_default.vertices, asked.vertices)
    assert fewer.facts.samples == 100 and 100 <= fewer.facts.proxy_vertices < 110
    if method is paper:
        dragged = Deformer(BODY, TASK.handles.index, method="paper").step(TASK.handles.target)
        assert dragged.facts.samples == transfer_pose(BODY, BODY.V, samplings=1).facts.samples == 160
        assert np.array_equal(bind(BODY).sampling.samples, bind(BODY, 160).sampling.samples)
        assert deformation_graph(TASK).extra["nodes"] == 160


@pytest.mark.parametrize(("run", "most"), [(paper, 10), (fast, 10), (None, 20)])
def test_memory_does_not_grow_with_the_number_of_samplings(run, most):
    mesh = bumpy(5)
    task = DeformationTask("body", mesh, end_handles(mesh.V, share=0.02, shift=[0, 0, 0.2]))
    peaks = []
    for samplings in (1, 1, most):  # the first call loads kernels
        options = {"vertices": 100, "samplings": samplings, "workers": 1}
        tracemalloc.start()
        if run is None:
            transfer_pose(mesh, bent(mesh.V), **options)
        else:
            run(task, **options, max_iterations=5)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[2] < peaks[1] + 6 * mesh.V.nbytes

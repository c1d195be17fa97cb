"""What the ablations put in the place of the method's own choices."""

import igl
import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra

from baselines.ablations import replaced
from baselines.ablations.replaced import FAR, cross_part, paper_with, project_to_surface
from sshade import Handles
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.rigid import rigid_motion
from sshade.proxy.projection import project_to_fans
from sshade.proxy.sample import proxy_mesh, sample_proxy
from sshade.regions.handle_regions import HandleRegions
from tests.shapes import folded, held_ends


def test_the_unrestricted_map_is_the_nearest_of_all_triangles(body):
    result = sample_proxy(body, 40, seed=1)
    proxy = proxy_mesh(body, result)
    projection = project_to_surface(body.V, proxy, result)
    squared = igl.point_mesh_squared_distance(np.array(body.V), np.array(proxy.V), np.array(proxy.F))[0]
    found, fan = (
        np.einsum("nc,ncx->nx", on.barycentric, proxy.V[proxy.F[on.face]])
        for on in (projection, project_to_fans(body.V, proxy, result))
    )
    distance = np.linalg.norm(found - body.V, axis=1)
    assert np.allclose(distance, np.sqrt(squared), rtol=0, atol=1e-12)
    assert (np.linalg.norm(fan - body.V, axis=1) >= distance - 1e-12).all()


def test_cross_part_projections_are_those_that_land_on_the_other_layer(monkeypatch):
    mesh = folded()
    result = sample_proxy(mesh, 120, seed=1)
    proxy = proxy_mesh(mesh, result)
    on_proxy = project_to_surface(mesh.V, proxy, result)
    far = cross_part(on_proxy, proxy, result)
    # By all shortest ways on the proxy.
    ways = dijkstra(vertex_graph(proxy).matrix, directed=False)
    nearest = ways[result.cell[:, None], proxy.F[on_proxy.face]].min(axis=1)
    assert np.array_equal(far, nearest > FAR * result.distance.max())
    assert 50 < far.sum() < mesh.n / 2
    layer = np.arange(mesh.n) // 17 > 40  # the first or the second half of the strip
    corners = layer[result.samples[proxy.F[on_proxy.face[far]]]]
    assert np.array_equal(corners, np.repeat(~layer[far], 3).reshape(-1, 3))
    assert not cross_part(project_to_fans(mesh.V, proxy, result), proxy, result).any()

    task, counts = held_ends(mesh, axis=0, share=0.02, turn=np.eye(3)), []
    counting = lambda *given: counts.append(cross_part(*given)) or counts[-1]  # noqa: E731
    monkeypatch.setattr(replaced, "cross_part", counting)
    extra = paper_with(task, projection="surface", vertices=150, samplings=2).extra
    assert extra["far_vertices"] == np.mean([count.sum() for count in counts])
    assert extra["far_share"] == pytest.approx(100 * extra["far_vertices"] / mesh.n)
    assert extra["far_share"] > 1


def test_the_sample_of_a_handles_region_gets_its_motion_and_a_mean_of_several(body):
    result = sample_proxy(body, 40, seed=(2, 0))
    index = np.flatnonzero(np.isin(result.cell, [3, 4]))
    regions = HandleRegions(body, Handles(index, body.V[index]), vertices=40, graph=vertex_graph(body))
    _, place = replaced.sample_nearest_to_handles(body, regions, (2, 0))
    target = np.random.default_rng(0).normal(size=(len(index), 3))
    handles = place(Handles(index, target))
    assert handles.index.tolist() == [3, 4]
    R, _ = rigid_motion(body.V[index], target)
    moved = target + (body.V[result.samples[result.cell[index]]] - body.V[index]) @ R.T
    for i, s in enumerate((3, 4)):
        mean = moved[result.cell[index] == s].mean(axis=0)
        assert np.allclose(handles.target[i], mean, rtol=0, atol=1e-13)

from unittest.mock import Mock

import numpy as np
import pytest

from sshade import Mesh
from sshade.mesh.adjacency import vertex_graph
from sshade.proxy import coarse, sample
from sshade.proxy.fronts import Fronts, farthest_point_sampling
from sshade.proxy.sample import sample_proxy
from tests.shapes import bumpy, double_torus, icosphere, strip, torus, tube
from tests.sshade.proxy.test_sample import assert_valid_proxy


def shuffled(mesh: Mesh) -> Mesh:
    """The same surface with its vertices in random order."""
    number = np.random.default_rng(0).permutation(mesh.n)
    return Mesh(mesh.V[np.argsort(number)], number[mesh.F])


def two_ends() -> Mesh:
    """A tube with nearly all vertices at its two ends, so that most slabs are empty."""
    mesh = tube(40, 60)
    V = np.array(mesh.V)
    end = np.where(V[:, 2] < 3, 0.0, 6.0)
    V[:, 2] = end + 1e-3 * (V[:, 2] - end)
    return Mesh(V, mesh.F)


SURFACES = {
    "sphere": icosphere(4),
    "bumpy": bumpy(4),
    "shuffled": shuffled(bumpy(4)),
    "strip, ties everywhere": strip(90, 30),
    "torus": torus(120, 40),
    "double torus": double_torus(cells=6),
    "tube": tube(40, 60),
    "needle": tube(5, 900),
    "all in two slabs": two_ends(),
}


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("count", [24, 150])
def test_cells_are_exact_and_the_second_half_is_farthest(name, count):
    mesh = SURFACES[name]
    graph = vertex_graph(mesh)
    first = np.random.default_rng(1).permutation(mesh.n)[:5]
    found = coarse.sample_coarsely(mesh, graph, count, first=first)
    samples = found.samples
    assert len(np.unique(samples)) == count and np.array_equal(samples[:5], first)
    all_at_once = Fronts(graph, samples)
    assert np.array_equal(found.distance, all_at_once.distance)
    assert np.array_equal(found.cell, all_at_once.cell)
    again = Fronts(graph, samples[: count // 2])
    again.insert_farthest(count - count // 2)
    assert np.array_equal(again.samples, samples)
    # The samples are about as dense as farthest points. The density of farthest points varies equally with
    # the first vertex.
    exact = farthest_point_sampling(graph, count, first=first)
    assert found.distance.max() <= 1.25 * exact.distance.max()
    assert found.distance.mean() <= 1.08 * exact.distance.mean()


def test_a_mesh_of_a_third_of_a_million_vertices_is_sampled_from_coarse_to_fine(monkeypatch):
    monkeypatch.setattr(coarse, "sample_coarsely", Mock(side_effect=InterruptedError))
    with pytest.raises(InterruptedError):
        sample_proxy(strip(600, 550), 10)


def test_crumpled_surfaces_get_a_finer_net(monkeypatch):
    """Distances on them are short for their area, so the first radius leaves too few vertices."""
    mesh = SURFACES["bumpy"]
    monkeypatch.setattr(coarse, "_NET_AREA", 1e4)
    found = coarse.sample_coarsely(mesh, vertex_graph(mesh), 60, first=np.array([0]))
    assert len(np.unique(found.samples)) == 60


@pytest.mark.parametrize("name", SURFACES)
def test_proxies_of_large_meshes_keep_the_topology(name, monkeypatch):
    monkeypatch.setattr(sample, "LARGE", 0)
    monkeypatch.setattr(coarse, "FINER", 0)
    mesh = SURFACES[name]
    for count in (5, 60, 300):
        assert_valid_proxy(mesh, sample_proxy(mesh, count, first=np.array([2, 9]), seed=3))

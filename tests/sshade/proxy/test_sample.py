import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sshade import InputError, Mesh
from sshade.proxy import sample as module
from sshade.proxy.sample import Sampling, proxy_mesh, sample_proxy
from tests.shapes import bumpy, double_torus, icosphere, jittered, strip, tetrahedron, torus, tube

SURFACES = {
    "sphere": icosphere(2),
    "tetrahedron": tetrahedron(),
    "triangle": Mesh(np.eye(3), [[0, 1, 2]]),
    "bumpy": bumpy(2),
    "torus": torus(),
    "thin torus": torus(60, 3, tube=0.05),
    "double torus": double_torus(),
    "fine double torus": double_torus(cells=4),
    "tube": tube(),
    "tube of three sides": tube(3, 40),
    **{f"strip {width} wide": strip(40, width) for width in (2, 3, 5, 8)},
    **{f"jittered strip {width} wide": jittered(strip(40, width), 0.1) for width in (2, 3, 5, 8)},
}


def assert_valid_proxy(mesh: Mesh, result: Sampling) -> None:
    """Assert that the proxy is manifold and oriented, keeps the topology, and uses every sample."""
    proxy = proxy_mesh(mesh, result)  # the constructor refuses unreferenced samples
    proxy.require_manifold()
    assert proxy.topology == mesh.topology
    assert proxy.is_closed == mesh.is_closed
    k = len(result.samples)
    assert len(np.unique(result.samples)) == k
    assert np.array_equal(proxy.V, mesh.V[result.samples])
    assert np.array_equal(result.faces.min(axis=1), result.faces[:, 0])
    assert len(np.unique(result.faces, axis=0)) == len(result.faces)
    # Cell k contains sample k. Only samples have the distance zero.
    assert np.array_equal(result.cell[result.samples], np.arange(k))
    assert np.array_equal(result.distance == 0, np.isin(np.arange(mesh.n), result.samples))


def turned(faces: list[list[int]]) -> set[tuple[int, ...]]:
    """Return each face with its smallest id first."""
    return {min((a, b, c), (b, c, a), (c, a, b)) for a, b, c in faces}


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("count", [1, 2, 3, 7, 0.1, 0.25, 1.0])
def test_the_proxy_keeps_the_topology(name, count):
    mesh = SURFACES[name]
    k = min(max(int(count * mesh.n) if isinstance(count, float) else count, 1), mesh.n)
    result = sample_proxy(mesh, k, seed=1)
    assert len(result.samples) == k + result.added
    assert_valid_proxy(mesh, result)
    # The faces are the triples of cells at triangles of the mesh, with its orientation.
    triples = [face for face in result.cell[mesh.F].tolist() if len(set(face)) == 3]
    assert turned(triples) == turned(result.faces.tolist())


@given(seed=st.integers(0, 10_000), k=st.integers(1, 150))
@pytest.mark.parametrize("name", ["double torus", "strip 3 wide", "tube"])
def test_the_proxy_is_valid_for_any_seed_and_size(name, seed, k):
    mesh = SURFACES[name]
    assert_valid_proxy(mesh, sample_proxy(mesh, min(k, mesh.n), seed=seed))


@pytest.mark.parametrize("k", [30, 31, 120])
def test_prescribed_samples_come_first_and_in_order(body, k):
    first = np.argsort(np.linalg.norm(body.V - body.V[17], axis=1))[:30]
    result = sample_proxy(body, k, first=first, seed=5)
    assert np.array_equal(result.samples[:30], first)
    assert_valid_proxy(body, result)


def test_the_random_vertex_follows_the_given_ones_and_is_none_of_them():
    mesh = tetrahedron()
    drawn = {int(sample_proxy(mesh, 4, first=np.array([2, 0]), seed=seed).samples[2]) for seed in range(30)}
    assert drawn == {1, 3}


def test_giving_up_names_the_cells(monkeypatch):
    monkeypatch.setattr(module, "MAX_ROUNDS", 0)
    words = r"remeshing to 4 vertices failed: after 0 rounds .*raise the option"
    with pytest.raises(InputError, match=words):
        sample_proxy(SURFACES["torus"], 4)


@pytest.mark.parametrize("name", ["torus", "double torus", "strip 2 wide", "tube", "tube of three sides"])
def test_a_proxy_of_another_topology_is_never_returned(monkeypatch, name):
    nothing = (np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int32))
    monkeypatch.setattr(module, "refinements", lambda F, fronts: nothing)
    errors = []
    for k in range(4, 30):
        try:
            assert_valid_proxy(SURFACES[name], sample_proxy(SURFACES[name], k))
        except InputError as error:
            assert re.fullmatch(f"remeshing to {k} vertices failed: .*; {module.MORE}", str(error))
            errors.append(str(error))
    assert errors
    if "tube" in name:  # an end closes: manifold and complete, but another surface
        assert any("the proxy has Topology" in error for error in errors)

"""One pass over the faces, against libigl, scipy and counting by sets."""

import igl
import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sshade import InputError
from sshade.mesh import connectivity as module
from sshade.mesh.connectivity import connectivity
from sshade.mesh.sides import sides_by_edge
from tests import shapes


def soup(seed: int, *, n: int = 12, m: int = 14) -> tuple[np.ndarray, int]:
    """Random triangles on few vertices, compacted: crowded edges, split vertices, components."""
    rng = np.random.default_rng(seed)
    F = np.array([rng.choice(n, 3, replace=False) for _ in range(m)])
    used, F = np.unique(F, return_inverse=True)
    return F.reshape(-1, 3), len(used)


def sides(F: np.ndarray) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """For each undirected edge the directions in which faces run through it."""
    found: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for face in F.tolist():
        for i, j in zip(face, face[1:] + face[:1], strict=True):
            found.setdefault((min(i, j), max(i, j)), []).append((i, j))
    return found


def labels(n: int, edges: list[tuple[int, int]]) -> tuple[int, np.ndarray]:
    i, j = np.array(edges, dtype=int).reshape(-1, 2).T
    return connected_components(coo_array((np.ones(len(i)), (i, j)), shape=(n, n)), directed=False)


MESHES = [
    shapes.icosphere(1),
    shapes.torus(),
    shapes.tube(),
    shapes.strip(5, 3),
    shapes.double_torus(cells=1),
]
CASES = [soup(seed) for seed in range(60)] + [(np.array(mesh.F), mesh.n) for mesh in MESHES]


@pytest.mark.parametrize("case", range(len(CASES)))
def test_facts_equal_those_of_sets_scipy_and_libigl(case):
    F, n = CASES[case]
    facts, edges = connectivity(F, n), sides(F)
    rim = [edge for edge, through in edges.items() if len(through) == 1]
    assert facts.edges == len(edges)
    table = sides_by_edge(F, n)
    assert [tuple(ends) for ends in table.ends.tolist()] == sorted(edges)
    assert table.faces.tolist() == [len(edges[edge]) for edge in sorted(edges)]
    assert facts.boundary_edges == len(rim)
    count, component = labels(n, list(edges))
    assert facts.components == count
    np.testing.assert_array_equal(facts.component, component)
    touched = {v for edge in rim for v in edge}
    assert facts.boundary_loops == labels(n, rim)[0] - (n - len(touched))
    assert facts.oriented == all(len(set(through)) == len(through) for through in edges.values())

    crowd = max(len(through) for through in edges.values())
    if crowd > 2:
        i, j, faces = facts.crowded_edge
        assert faces == crowd == len(edges[i, j])
    else:
        assert facts.crowded_edge.tolist() == [-1, -1, -1]
        split = ~np.asarray(igl.is_vertex_manifold(F)).ravel()
        assert facts.split_vertex == (int(np.argmax(split)) if split.any() else -1)


def test_tables_of_more_entries_than_ids_have_bits_are_refused(monkeypatch):
    mesh = shapes.tetrahedron()
    monkeypatch.setattr(module, "MOST", 11)
    with pytest.raises(InputError, match="6 edges, and at most 5 are supported"):
        connectivity(mesh.F, mesh.n)
    monkeypatch.setattr(module, "MOST", 12)
    assert connectivity(mesh.F, mesh.n).edges == 6

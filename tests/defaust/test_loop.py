"""Loop's rules against libigl's, on the subdivisions of pymeshlab and of the example."""

import igl
import numpy as np
import pytest
from scipy.spatial import cKDTree

from defaust.build.upsample import subdivide
from defaust.tasks.loop import loop_matrix, split
from tests.shapes import double_torus, icosphere, tetrahedron

MESHES = {
    "tetrahedron": tetrahedron(),  # valence 3 everywhere
    "icosphere": icosphere(1),  # valences 5 and 6
    "double torus": double_torus(cells=1),  # valences up to 8
}


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("method", ["pymeshlab", "split"])
def test_positions_are_those_of_libigl(name, method):
    mesh = MESHES[name]
    fine = subdivide(mesh, steps=2) if method == "pymeshlab" else split(split(mesh))
    L = loop_matrix(mesh, fine, steps=2)
    V, F = igl.loop(np.array(mesh.V), np.array(mesh.F), 2)
    np.testing.assert_allclose(L.sum(axis=1), 1)
    assert L.data.min() > 0
    distance, place = cKDTree(V).query(L @ mesh.V)
    assert distance.max() < 1e-12
    assert len(np.unique(place)) == len(V) == fine.n
    # The same triangles: each vertex is where libigl has it, not only some vertex.
    assert {tuple(sorted(f)) for f in place[fine.F].tolist()} == {tuple(sorted(f)) for f in F.tolist()}

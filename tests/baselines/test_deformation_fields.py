"""Harmonic and biharmonic fields against dense solutions and closed forms."""

import igl
import numpy as np
import pytest

from baselines.deformation_fields import deformation_field
from sshade.solver.laplacian import edge_weights, half_cotangents, laplacian_matrix
from tests.shapes import bumpy, held_ends


@pytest.mark.parametrize("order", [1, 2])
def test_the_field_solves_its_equation(order):
    task = held_ends(bumpy(2))
    mesh, handles = task.mesh, task.handles
    L = laplacian_matrix(mesh.n, *edge_weights(mesh, half_cotangents(mesh))).toarray()
    if order == 2:
        areas = igl.massmatrix(np.array(mesh.V), np.array(mesh.F), igl.MASSMATRIX_TYPE_VORONOI).diagonal()
        L = L @ (L / areas[:, None])
    free = np.setdiff1d(np.arange(mesh.n), handles.index)
    d = np.zeros((mesh.n, 3))
    d[handles.index] = handles.target - mesh.V[handles.index]
    d[free] = np.linalg.solve(L[np.ix_(free, free)], -L[np.ix_(free, handles.index)] @ d[handles.index])
    result = deformation_field(task, order=order)
    assert np.abs(result.vertices - (mesh.V + d)).max() < 1e-10 * mesh.diagonal

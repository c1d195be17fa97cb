"""Harmonic and biharmonic fields against dense solutions and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.deformation_fields import deformation_field
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.solver.cotangents import edge_weights, half_cotangents, laplacian_matrix
from sshade.task import DeformationTask, Handles
from tests.shapes import bumpy, held_ends, jittered, rotation, strip


def test_the_harmonic_field_solves_laplaces_equation():
    task = held_ends(bumpy(2))
    mesh, handles = task.mesh, task.handles
    L = laplacian_matrix(mesh.n, *edge_weights(mesh, half_cotangents(mesh))).toarray()
    free = np.setdiff1d(np.arange(mesh.n), handles.index)
    d = np.zeros((mesh.n, 3))
    d[handles.index] = handles.target - mesh.V[handles.index]
    d[free] = np.linalg.solve(L[np.ix_(free, free)], -L[np.ix_(free, handles.index)] @ d[handles.index])
    result = deformation_field(task, order=1)
    assert np.abs(result.vertices - (mesh.V + d)).max() < 1e-10 * mesh.diagonal


def test_the_harmonic_field_of_a_sheet_pulled_at_its_ends_is_linear():
    sheet = jittered(strip(12, 4), 0.1)
    border = np.unique(sheet.boundary_edges)
    field = np.stack([0.5 * sheet.V[:, 0], 0.2 * sheet.V[:, 1] - sheet.V[:, 0], 0.1 * sheet.V[:, 0]], axis=1)
    flat = Mesh(sheet.V * [1, 1, 0], sheet.F)
    task = DeformationTask("linear", flat, Handles(border, (flat.V + field)[border]))
    expected = flat.V + field
    # A linear function of the plane is harmonic for cotangent weights; z was taken out above.
    assert np.abs(deformation_field(task).vertices - expected)[:, [0, 2]].max() < 1e-10 * flat.diagonal


def test_the_biharmonic_field_is_smooth_at_a_handle_where_the_harmonic_one_has_a_spike():
    sheet = jittered(strip(16, 16), 0.1)
    centre = int(np.argmin(np.linalg.norm(sheet.V - [8, 8, 0], axis=1)))
    border = np.unique(sheet.boundary_edges)
    target = np.vstack([sheet.V[border], sheet.V[centre] + [0, 0, 3]])
    task = DeformationTask("peak", sheet, Handles(np.append(border, centre), target))
    ring = np.setdiff1d(sheet.F[(centre == sheet.F).any(axis=1)], centre)
    drop = [3 - deformation_field(task, order=k).vertices[ring, 2].mean() for k in (1, 2)]
    assert drop[1] < 0.3 * drop[0]


@pytest.mark.parametrize("order", [1, 2])
def test_a_rigid_motion_is_reproduced_from_the_rigid_start_alone(order):
    mesh = bumpy(2)
    index = np.argsort(mesh.V[:, 2])[[0, 1, 2, 3, -3, -2, -1]]
    expected = mesh.V @ rotation(3).T + [1.0, -2, 0.5]
    task = DeformationTask("rigid", mesh, Handles(index, expected[index]))
    gap = [
        np.abs(deformation_field(task, order=order, start=start).vertices - expected).max()
        for start in ("rigid", "rest")
    ]
    assert gap[0] < 1e-10 * mesh.diagonal < gap[1]


def test_what_it_cannot_take_is_refused():
    task = held_ends(bumpy(1))
    for options in ({"order": 3}, {"start": "guess"}):
        with pytest.raises(InputError, match="order|start"):
            deformation_field(task, **options)
    V = np.array(task.mesh.V)
    face = task.mesh.F[0]
    V[face[2]] = V[face[:2]].mean(axis=0)
    with pytest.raises(InputError, match="1 triangles of the rest mesh have no area"):
        deformation_field(DeformationTask("flat", Mesh(V, task.mesh.F), task.handles))

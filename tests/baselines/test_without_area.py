"""Faces without area under the methods of comparison: deformed, or refused in one sentence."""

import numpy as np
import pytest

from baselines.accelerated import accelerated_arap, accelerated_elastic
from baselines.arap import arap, elastic
from baselines.arap_sr.arap_sr import arap_sr
from baselines.deformation_graph.deformation_graph import deformation_graph
from sshade import DeformationTask, InputError, Mesh
from tests.shapes import QUARTER, bumpy, end_handles

BODY = bumpy(3)


def task(mesh: Mesh) -> DeformationTask:
    return DeformationTask("ends", mesh, end_handles(BODY.V, turn=QUARTER, shift=[0, 0, 0.1]))


def collapsed() -> Mesh:
    """Two edges and a face collapsed in place."""
    V = np.array(BODY.V)
    middle = BODY.F[np.abs(V[BODY.F][:, :, 2]).max(axis=1) < 1]
    for face in middle[[0, 90]]:
        V[face[1]] = V[face[0]]
    V[middle[180, 1:]] = V[middle[180, 0]]
    return Mesh(V, BODY.F)


@pytest.mark.parametrize("method", [accelerated_arap, accelerated_elastic, arap_sr, deformation_graph])
def test_collapsed_faces_are_deformed_as_those_around_them(method):
    mesh = collapsed()
    assert mesh.without_area.sum() >= 6
    sound, flat = (method(task(m)) for m in (BODY, mesh))
    assert flat.converged
    far = np.setdiff1d(np.arange(BODY.n), BODY.F[mesh.without_area])
    assert np.linalg.norm((sound.vertices - flat.vertices)[far], axis=1).max() < 0.05 * mesh.diagonal
    a, b = mesh.edges[np.linalg.norm(mesh.V[mesh.edges[:, 0]] - mesh.V[mesh.edges[:, 1]], axis=1) == 0].T
    assert np.linalg.norm(flat.vertices[a] - flat.vertices[b], axis=1).max() < 0.01 * mesh.diagonal


@pytest.mark.parametrize("method", [arap, elastic])
def test_libigl_makes_nan_of_them_and_is_not_asked(method):
    with pytest.raises(
        InputError, match=r"\d triangles of the rest mesh have no area, and libigl would return NaN"
    ):
        method(task(collapsed()))

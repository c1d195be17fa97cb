"""Lattices around surfaces of any kind, and ARAP on them."""

import numpy as np
import pytest

from baselines.volumetric.lattice import lattice
from baselines.volumetric.lattice_arap import lattice_arap
from sshade.problem.task import DeformationTask, Handles
from tests.shapes import block, bumpy, folded, held_ends, icosphere, jittered, rotation, strip, tube

SURFACES = {
    "closed": bumpy(2),
    "open": tube(),
    "sheet": jittered(strip(12, 6), 0.1),
    "folded": folded(40, 8),
    "not manifold": block(np.array([[[1], [0]], [[0], [1]]]), cells=3),
}


def test_a_filled_lattice_has_the_volume_of_the_shape():
    mesh = icosphere(3)
    side = mesh.diagonal / 30
    shell, full = (len(lattice(mesh, cells=30, filled=filled).cubes) for filled in (False, True))
    assert shell * side**3 < 0.8 * mesh.volume < mesh.volume < full * side**3 < 1.5 * mesh.volume


@pytest.mark.parametrize("mesh", SURFACES.values(), ids=SURFACES)
def test_lattice_arap_reproduces_rigid_motions_of_any_surface(mesh):
    index = np.argsort(mesh.V[:, 0] + 0.1 * mesh.V[:, 1])[[0, 1, 2, 3, -4, -3, -2, -1]]
    expected = mesh.V @ rotation(2).T + [3.0, 0, -1]
    task = DeformationTask("rigid", mesh, Handles(index, expected[index]))
    result = lattice_arap(task, cells=14, start="rigid")
    assert result.converged
    assert np.abs(result.vertices - expected).max() < 1e-9 * mesh.diagonal


def test_lattice_arap_is_stationary_where_it_stops():
    task = held_ends(bumpy(2))
    options = {"cells": 10, "tolerance": 1e-10, "max_iterations": 5000}
    first = lattice_arap(task, **options, start="rest")
    second = lattice_arap(task, **options, start="rigid")
    assert first.converged and second.converged
    assert np.abs(first.vertices - second.vertices).max() < 1e-6 * task.mesh.diagonal
    assert first.extra["handle_before"] < 5e-3

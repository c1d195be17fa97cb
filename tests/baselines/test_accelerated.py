"""The accelerated methods on meshes of several components."""

import numpy as np
import pytest

from baselines.accelerated import accelerated_arap, accelerated_elastic
from sshade import DeformationTask, Handles, Mesh
from tests.shapes import icosphere

ONE = icosphere(2)


@pytest.mark.parametrize("method", [accelerated_arap, accelerated_elastic])
def test_each_component_keeps_its_volume(method):
    V = np.concatenate([ONE.V, 1.5 * ONE.V + 5])
    both, index = Mesh(V, np.concatenate([ONE.F, ONE.F + ONE.n])), np.array([0, 11, ONE.n, ONE.n + 11])
    moves = np.array([[0, 0, 0], [0.1, 0.3, 0], [0, 0, 0], [0.2, 0.6, 0]])
    task = DeformationTask("two", both, Handles(index, V[index] + moves))
    free, held = method(task), method(task, volume=np.inf)
    for part, volume in ((slice(0, ONE.n), ONE.volume), (slice(ONE.n, None), 1.5**3 * ONE.volume)):
        assert Mesh(held.vertices[part], ONE.F).volume == pytest.approx(volume, rel=1e-6)
        assert Mesh(free.vertices[part], ONE.F).volume != pytest.approx(volume, rel=1e-3)
    assert held.extra["components"] == 2

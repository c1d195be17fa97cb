"""The accelerated methods on meshes of several components."""

import numpy as np
import pytest

from baselines.accelerated import accelerated_arap, accelerated_elastic
from sshade import DeformationTask, Mesh
from tests.shapes import beside, icosphere, moved_parts

ONE = icosphere(2)


@pytest.mark.parametrize("method", [accelerated_arap, accelerated_elastic])
def test_each_component_keeps_its_volume(method):
    both = beside(ONE, Mesh(1.5 * ONE.V + 5, ONE.F))
    parts = ([0, ONE.n], 0), ([11], [0.1, 0.3, 0]), ([ONE.n + 11], [0.2, 0.6, 0])
    task = DeformationTask("two", both, moved_parts(both.V, *parts))
    free, held = method(task), method(task, volume=np.inf)
    for part, volume in ((slice(0, ONE.n), ONE.volume), (slice(ONE.n, None), 1.5**3 * ONE.volume)):
        assert Mesh(held.vertices[part], ONE.F).volume == pytest.approx(volume, rel=1e-6)
        assert Mesh(free.vertices[part], ONE.F).volume != pytest.approx(volume, rel=1e-3)
    assert held.extra["components"] == 2

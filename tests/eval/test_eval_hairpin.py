"""The bent tube with limbs that nearly touch."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defaust.tasks.hairpin import HANDLES, PARTING, SIDE_BY_SIDE, hairpin, hairpin_task


def test_the_limbs_are_a_gap_apart():
    mesh = hairpin(gap=0.3, around=48)
    assert mesh.topology.euler == 2 and mesh.is_closed and mesh.is_manifold and mesh.volume > 0
    x = mesh.V[mesh.V[:, 2] < SIDE_BY_SIDE, 0]
    assert x[x > 0].min() == pytest.approx(0.15, abs=1e-12)
    assert x[x < 0].max() == pytest.approx(-0.15, abs=1e-12)


def test_one_end_is_held_and_the_other_turned_about_the_bend():
    task = hairpin_task(gap=0.05, angle=30, around=24)
    handles, rest = task.handles, task.mesh.V[task.handles.index]
    assert handles.dynamic.tolist() == [False] * HANDLES + [True] * HANDLES
    assert np.array_equal(handles.target[:HANDLES], rest[:HANDLES]) and (rest[:HANDLES, 0] < 0).all()
    centre = np.array([0, 0, 1 + SIDE_BY_SIDE + PARTING])
    before, after = rest[HANDLES:] - centre, handles.target[HANDLES:] - centre
    assert np.allclose(after, Rotation.from_euler("y", -30, degrees=True).apply(before), rtol=0, atol=1e-12)
    assert after[:, 0].min() > before[:, 0].max()  # outwards

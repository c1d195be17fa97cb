"""Results have the same bits on one core and on several."""

import os

import numpy as np
import pytest

from defaust.sources.synthetic import SyntheticBodies
from sshade import DeformationTask, Handles, deform
from sshade.core.threads import available_cpus
from tests.shapes import subdivided


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity") or available_cpus() < 2, reason="takes two cores")
def test_the_same_bits_on_one_core_as_on_several():
    """Threads share the work on a body of 27,554 vertices."""
    source = SyntheticBodies()
    rest, posed = (subdivided(mesh) for mesh in (source.rest(0), source.posed(0, source.poses(0)[0])))
    marks = rest.V[list(source.landmark_vertices(0).values())]
    index = np.unique([np.argsort(((rest.V - mark) ** 2).sum(axis=1))[:10] for mark in marks])
    task = DeformationTask("body", rest, Handles(index, posed.V[index]))
    all_cores = os.sched_getaffinity(0)
    several = deform(task, method="fine", polish_iterations=5).vertices
    os.sched_setaffinity(0, {min(all_cores)})
    try:
        one = deform(task, method="fine", polish_iterations=5).vertices
    finally:
        os.sched_setaffinity(0, all_cores)
    assert np.array_equal(one, several)

"""Results have the same bits on one core and on several."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest

from baselines.accelerated import accelerated_elastic
from defaust.sources.synthetic import SyntheticBodies
from sshade import DeformationTask, Handles, Mesh, deform
from sshade.core.threads import available_cpus
from sshade.proxy.sample import sample_proxy
from tests.shapes import subdivided

METHODS = ("paper", "fast", "fine")


def digests() -> list[str]:
    """Return a line for each array of the proxy and for each result, on a body of 27,554 vertices.

    Threads share the work on a body of this size.
    """
    source = SyntheticBodies()
    rest, posed = (subdivided(mesh) for mesh in (source.rest(0), source.posed(0, source.poses(0)[0])))
    marks = rest.V[list(source.landmarks.values())]
    index = np.unique([np.argsort(((rest.V - mark) ** 2).sum(axis=1))[:10] for mark in marks])
    task = DeformationTask("body", rest, Handles(index, posed.V[index]))
    proxy = sample_proxy(Mesh(rest.V, rest.F), 6000)
    results = {"samples": proxy.samples, "proxy": proxy.faces, "regions": proxy.cell}
    results["accelerated_elastic"] = accelerated_elastic(task, seed=0).vertices
    for name in METHODS:
        results[name] = deform(task, method=name, seed=0).vertices
    return [f"{name} {hashlib.sha256(found.tobytes()).hexdigest()}" for name, found in results.items()]


@pytest.mark.skipif(
    not hasattr(os, "sched_setaffinity") or available_cpus() < 2, reason="it takes two cores to compare with"
)
def test_the_same_bits_on_one_core_as_on_several():
    """Run fresh processes, because libraries read the usable cores when they start their threads."""
    one = min(os.sched_getaffinity(0))
    found = []
    for before in (f"import os; os.sched_setaffinity(0, {{{one}}}); ", ""):
        command = f"{before}from {__name__} import digests; print(*digests(), sep='\\n')"
        done = subprocess.run([sys.executable, "-c", command], check=True, stdout=-1, text=True)
        found.append(done.stdout.splitlines())
    assert found[0] == found[1] and len(found[0]) == 7

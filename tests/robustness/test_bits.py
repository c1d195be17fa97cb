"""Results have the same bits with any number of cores, workers and threads.

Kernels that are loaded give the same bits as when they were compiled.
"""

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

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
METHODS = ("paper", "fast", "fine")
SEEDS = 2


def digests(seeds: int = 1) -> list[str]:
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
        for seed in range(seeds):
            results[f"{name} {seed}"] = deform(task, method=name, seed=seed).vertices
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


@pytest.mark.full
def test_the_same_bits_with_other_threads_and_caches(tmp_path):
    """Run fresh processes: one compiles every kernel, one loads the kernels, one has one thread, one two.

    Kernels compiled for this very processor round differently from kernels that are shipped. The samples
    and the proxy are the same.
    """
    expected = digests(SEEDS)
    command = [sys.executable, "-c", f"from {__name__} import digests; print(*digests({SEEDS}), sep='\\n')"]
    cache = {"SSHADE_KERNELS": str(tmp_path)}
    compiled, loaded, one, two = (
        subprocess.run(command, env=os.environ | own, check=True, stdout=-1, text=True).stdout.splitlines()
        for own in (cache, cache, dict.fromkeys(THREADS, "1"), dict.fromkeys(THREADS, "2"))
    )
    assert compiled == loaded and one == two == expected
    assert compiled[:3] == expected[:3] and len(compiled) == len(expected)

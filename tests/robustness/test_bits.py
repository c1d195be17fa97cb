"""The same bits from any number of cores, workers and threads, and from kernels compiled now or loaded."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from functools import partial

import numpy as np
import pytest

from baselines.accelerated import accelerated_elastic
from defaust.sources.synthetic import SyntheticBodies
from sshade import DeformationTask, Handles, Mesh, deform
from sshade.sampling.proxy import sample_proxy
from sshade.threads import available_cpus
from tests.robustness.inputs import BODY, pose
from tests.shapes import subdivided

METHODS = {
    "paper": partial(deform, method="paper", vertices=50, samplings=3),
    "fast": partial(deform, method="fast", vertices=50, samplings=2),
    "fine": partial(deform, method="fine", vertices=50, polish_iterations=5),
}
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
SEEDS = 20


def digests(workers: int) -> list[str]:
    """A line for each method and seed: its name and the sha256 of its result."""
    task = DeformationTask("body", BODY, pose(BODY.V))
    return [
        f"{name} {seed} {_digest(method(task, seed=seed, workers=workers).vertices)}"
        for name, method in METHODS.items()
        for seed in range(SEEDS)
    ]


def body_digests() -> list[str]:
    """A line for each of the methods, and for the proxy, of a body of 27,554 vertices: as many rows as
    threads share.
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
    return [f"{name} {_digest(result)}" for name, result in results.items()]


def _digest(array: np.ndarray) -> str:
    return hashlib.sha256(array.tobytes()).hexdigest()


@pytest.mark.skipif(
    not hasattr(os, "sched_setaffinity") or available_cpus() < 2, reason="it takes two cores to compare with"
)
def test_the_same_bits_on_one_core_as_on_several():
    """Fresh processes: what a process may use is read when libraries start their threads."""
    one = min(os.sched_getaffinity(0))
    found = []
    for before in (f"import os; os.sched_setaffinity(0, {{{one}}}); ", ""):
        command = f"{before}from {__name__} import body_digests; print(*body_digests(), sep='\\n')"
        done = subprocess.run([sys.executable, "-c", command], check=True, stdout=-1, text=True)
        found.append(done.stdout.splitlines())
    assert found[0] == found[1] and len(found[0]) == 7


@pytest.mark.full
def test_the_same_bits_with_other_workers_threads_and_caches(tmp_path):
    """Fresh processes: one compiles every kernel, the next loads them, others have so many threads."""
    expected = digests(workers=1)
    assert digests(workers=2) == expected
    command = [sys.executable, "-c", f"from {__name__} import digests; print(*digests(1), sep='\\n')"]
    cache = {"NUMBA_CACHE_DIR": str(tmp_path)}
    for environment in (cache, cache, dict.fromkeys(THREADS, "1"), dict.fromkeys(THREADS, "2")):
        done = subprocess.run(command, env=os.environ | environment, check=True, stdout=-1, text=True)
        assert done.stdout.splitlines() == expected, environment

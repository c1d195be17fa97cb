"""The same bits from any number of workers and threads, and from kernels compiled now or loaded."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from functools import partial

import numpy as np
import pytest

from sshade import DeformationTask, sshade
from sshade.pipeline.fast import sshade_fast
from sshade.pipeline.fine import sshade_fine
from tests.robustness.inputs import BODY, pose

METHODS = {
    "paper": partial(sshade, vertices=50, samplings=3),
    "fast": partial(sshade_fast, vertices=50, samplings=2),
    "fine": partial(sshade_fine, vertices=50, polish_iterations=5),
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


def _digest(V: np.ndarray) -> str:
    return hashlib.sha256(V.tobytes()).hexdigest()


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

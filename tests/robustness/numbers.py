"""The same bits again: ``python -m tests.robustness.numbers [--seeds N]``.

Deforms with each seed, and compares the results of one and two workers, and of
fresh processes: one that compiles every kernel, one that loads them, one with
a single thread for every library.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import partial

import numpy as np

from sshade import DeformationTask, deform
from sshade.pipeline.fine import sshade_fast, sshade_fine
from tests.robustness.inputs import BODY, pose

METHODS = {
    "paper": partial(deform, vertices=50, samplings=3),
    "fast": partial(sshade_fast, vertices=50, samplings=2),
    "fine": partial(sshade_fine, vertices=50, polish_iterations=5),
}
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def digests(seeds: Sequence[int], *, workers: int) -> list[str]:
    """A line for each method and seed: its name and the sha256 of its result."""
    task = DeformationTask("body", BODY, pose(BODY.V))
    return [
        f"{name} {seed} {_digest(method(task, seed=seed, workers=workers).vertices)}"
        for name, method in METHODS.items()
        for seed in seeds
    ]


def _digest(V: np.ndarray) -> str:
    return hashlib.sha256(V.tobytes()).hexdigest()


def in_a_process(seeds: Sequence[int], **environment: str) -> list[str]:
    """The same of a fresh process, with other environment variables."""
    command = [sys.executable, "-m", "tests.robustness.numbers", "--print", *map(str, seeds)]
    done = subprocess.run(
        command, env={**os.environ, **environment}, check=True, capture_output=True, text=True, timeout=900
    )
    return done.stdout.splitlines()


def compare(seeds: Sequence[int]) -> dict[str, bool]:
    """Which ways of computing give the same bits as one worker in this process."""
    expected = digests(seeds, workers=1)
    same = {"2 workers": digests(seeds, workers=2) == expected}
    with tempfile.TemporaryDirectory() as cache:
        same["cold cache"] = in_a_process(seeds, NUMBA_CACHE_DIR=cache) == expected
        same["warm cache"] = in_a_process(seeds, NUMBA_CACHE_DIR=cache) == expected
    same["1 thread"] = in_a_process(seeds, **dict.fromkeys(THREADS, "1")) == expected
    same["2 threads"] = in_a_process(seeds, **dict.fromkeys(THREADS, "2")) == expected
    return same


def main() -> int:
    """Print the comparison; exit code 1 if any bit differs."""
    parser = argparse.ArgumentParser(prog="python -m tests.robustness.numbers", description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--print", type=int, nargs="+", dest="printed", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.printed:
        print("\n".join(digests(options.printed, workers=1)))  # noqa: T201
        return 0
    same = compare(range(options.seeds))
    for way, equal in same.items():
        print(f"{way:12} {'the same bits' if equal else 'OTHER BITS'}")  # noqa: T201
    compared = len(METHODS) * options.seeds
    print(f"{compared} results ({options.seeds} seeds), each computed in {len(same) + 1} ways")  # noqa: T201
    return 0 if all(same.values()) else 1


if __name__ == "__main__":
    sys.exit(main())

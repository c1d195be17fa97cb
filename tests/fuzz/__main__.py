"""Fuzz a reader: ``python -m tests.fuzz mesh|handles|yaml|manifest|map|all|native --executions N``.

Guided by coverage with atheris (``pip install sshade[fuzz]``). Nothing but an
InputError may come out of a reader; what does is printed, kept as a file, and
exit code 1. ``native`` instead feeds files of other formats, which compiled
code reads, to a child process under a time limit.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from tests.fuzz.native import fuzz_native
from tests.fuzz.targets import TARGETS

#: Seconds that one input may take, and MiB of memory that the process may.
SECONDS, MEMORY = 20, 4096
#: Longest input.
LENGTH = 60_000


class Found(NamedTuple):
    """Executions done, edges covered, and what went wrong; empty where nothing did."""

    executions: int
    edges: int
    problem: str


def fuzz(name: str, executions: int, *, seed: int, crashes: Path, corpus: Path | None = None) -> Found:
    """Fuzz a reader in a child process, which ends with the first crash.

    Parameters
    ----------
    name : str
        Of the target.
    executions : int
    seed : int
    crashes : Path
        A folder for inputs that crash.
    corpus : Path, optional
        A folder of inputs to begin with, and for those worth keeping.
    """
    memory = "/dev/shm"  # where there is one, its files cost nothing
    with tempfile.TemporaryDirectory(dir=memory if Path(memory).is_dir() else None) as scratch:
        found = corpus or Path(scratch, "corpus")
        found.mkdir(exist_ok=True)
        command = [sys.executable, "-m", "tests.fuzz.guided", name, str(found), scratch]
        command += [f"-atheris_runs={executions}", f"-seed={seed}", f"-max_len={LENGTH}"]
        command += [f"-timeout={SECONDS}", f"-rss_limit_mb={MEMORY}", f"-artifact_prefix={crashes}/{name}-"]
        environment = {**os.environ, "TMPDIR": scratch}
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", env=environment)
    counts = [int(number) for number in re.findall(r"^#(\d+)\s", done.stderr, re.MULTILINE)]
    counts += [int(number) for number in re.findall(r"Done (\d+) ", done.stderr)]
    covered = re.findall(r"cov: (\d+)", done.stderr)
    # Its timer may still end the process once it is done.
    ended = re.search(r"^Done \d+ in", done.stderr, re.MULTILINE) and "ERROR: libFuzzer" not in done.stderr
    problem = "" if ended else f"exit code {done.returncode}\n{done.stderr[-3000:]}"
    return Found(max(counts, default=0), int(covered[-1]) if covered else 0, problem)


def main() -> int:
    """Fuzz, and print the figures."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("target", choices=[*TARGETS, "all", "native"])
    parser.add_argument("--executions", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--crashes", type=Path, default=Path("crashes"), help="folder for inputs that crash")
    options = parser.parse_args()
    options.crashes.mkdir(exist_ok=True)
    if options.target == "native":
        failures = fuzz_native(options.executions, seed=options.seed, crashes=options.crashes)
        print(f"native: {options.executions} files, {failures} crashes")  # noqa: T201
        return 1 if failures else 0
    total, failed = 0, False
    for name in TARGETS if options.target == "all" else [options.target]:
        found = fuzz(name, options.executions, seed=options.seed, crashes=options.crashes)
        print(f"{name}: {found.executions} executions, {found.edges} edges covered")  # noqa: T201
        total += found.executions
        if found.problem:
            failed = True
            print(found.problem)  # noqa: T201
    if not failed and not any(options.crashes.iterdir()):
        options.crashes.rmdir()
    print(f"{total} executions, {'CRASHES' if failed else 'no crash'}")  # noqa: T201
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

"""Kernels as plain Python: ``python -m tests.robustness.uncompiled`` compares them with what is compiled.

Numba checks no bounds and has arithmetic of its own. A child process runs the same
work on tiny meshes with ``NUMBA_DISABLE_JIT=1``, where an index out of range is an
error; its results must be the compiled ones, and every kernel must have been called.
"""

from __future__ import annotations

import argparse
import ast
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

import numpy as np

from tests.robustness.kernel_work import WORK

ROOT = Path(__file__).parents[2]
PACKAGES = ("sshade", "baselines", "defaust", "eval")
#: Apart, relative to the largest value: the compiler contracts and reorders sums.
CLOSE = 1e-9


class Comparison(NamedTuple):
    """What the uncompiled work gave.

    Parameters
    ----------
    apart : dict
        Largest difference of each piece of work, relative.
    called, missed : list of str
        Kernels, as file:name.
    """

    apart: dict[str, float]
    called: list[str]
    missed: list[str]

    @property
    def failures(self) -> list[str]:
        """Sentences."""
        found = [f"{name}: {gap:.1e} apart" for name, gap in self.apart.items() if not gap <= CLOSE]
        return found + [
            f"{kernel} was not called; kernel_work.py needs work that does" for kernel in self.missed
        ]


def kernels() -> list[str]:
    """Every function that numba compiles, as file:name."""
    found = []
    for path in sorted(p for name in PACKAGES for p in (ROOT / name).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and any(
                "njit" in ast.unparse(d) for d in node.decorator_list
            ):
                found.append(f"{path.relative_to(ROOT)}:{node.name}")
    return found


def compare() -> Comparison:
    """Do the work compiled here, uncompiled in a child process."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "plain.npz")
        command = [sys.executable, "-m", "tests.robustness.uncompiled", "--write", str(path)]
        environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
        if done.returncode:
            raise AssertionError(done.stderr)
        with np.load(path, allow_pickle=False) as data:
            plain = {name: data[name] for name in data.files}
    called = set(plain.pop("called").tolist())
    apart = {}
    for name, work in WORK.items():
        expected, found = np.asarray(work(), dtype=float), np.asarray(plain[name], dtype=float)
        same = expected.shape == found.shape
        apart[name] = np.abs(found - expected).max() / np.abs(expected).max() if same else np.inf
    known = kernels()
    return Comparison(apart, [k for k in known if k in called], [k for k in known if k not in called])


def write_uncompiled(path: Path) -> None:
    """Do the work, and note which functions were called."""
    seen = set()

    def note(frame: FrameType, event: str, _: Any) -> None:
        if event == "call":
            seen.add(frame.f_code)

    found = {}
    for name, work in WORK.items():
        sys.setprofile(note)
        try:
            found[name] = work()
        finally:
            sys.setprofile(None)
    root = f"{ROOT}{os.sep}"
    called = {
        f"{c.co_filename.removeprefix(root)}:{c.co_name}" for c in seen if c.co_filename.startswith(root)
    }
    np.savez(path, called=np.array(sorted(called)), **found)


def main() -> int:
    """Print the comparison; exit code 1 where something differs or was not called."""
    parser = argparse.ArgumentParser(prog="python -m tests.robustness.uncompiled", description=__doc__)
    parser.add_argument("--write", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.write:
        write_uncompiled(options.write)
        return 0
    found = compare()
    for name, gap in found.apart.items():
        print(f"{name:24} {gap:.1e}")  # noqa: T201
    print(f"{len(found.called)} of {len(kernels())} kernels called uncompiled")  # noqa: T201
    for failure in found.failures:
        print(failure)  # noqa: T201
    return 1 if found.failures else 0


if __name__ == "__main__":
    sys.exit(main())

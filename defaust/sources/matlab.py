"""MATLAB files of surfaces, read in a separate process.

SciPy's compiled reader can crash on a damaged file. The separate process keeps a crash from ending the build.
``python -m defaust.sources.matlab FILE`` writes the arrays to standard output.
"""

from __future__ import annotations

import io
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np


def read_surface(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read a struct with X, Y, Z and TRIV, such as TOSCA's ``surface``.

    Returns
    -------
    (n, 3) float64
        Positions.
    (m, 3) int64
        Triangles, counted from 1.

    Raises
    ------
    ValueError
        When the file has no such struct, or cannot be read.
    """
    command = [sys.executable, "-m", "defaust.sources.matlab", str(path)]
    done = subprocess.run(command, capture_output=True)
    if done.returncode < 0:
        raise ValueError(f"its reader was ended by {signal.Signals(-done.returncode).name}")
    if done.returncode:
        lines = done.stderr.decode(errors="replace").strip().split("\n")
        raise ValueError(lines[-1] or "its reader failed")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as arrays:
        return arrays["V"], arrays["F"]


def _surface(path: str) -> tuple[np.ndarray, np.ndarray]:
    from scipy.io import loadmat

    for value in loadmat(path, simplify_cells=True).values():
        if isinstance(value, Mapping) and {"X", "Y", "Z", "TRIV"} <= set(value):
            V = np.stack([np.ravel(value[axis]).astype(np.float64) for axis in "XYZ"], axis=1)
            return V, np.atleast_2d(value["TRIV"]).astype(np.int64)
    raise ValueError("it holds no struct with X, Y, Z and TRIV")


if __name__ == "__main__":
    try:
        vertices, triangles = _surface(sys.argv[1])
    except Exception as error:  # a reader fails in many ways, always because of the file
        sys.exit(" ".join(str(error).split()) or type(error).__name__)
    np.savez(sys.stdout.buffer, V=vertices, F=triangles)

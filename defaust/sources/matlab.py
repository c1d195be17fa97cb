"""MATLAB's files of surfaces, read in a process of their own: SciPy's reader can end it on a damaged file."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from sshade.processes import end_with_parent


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
        When the file has none, or its reader came to its end on it.
    Exception
        Whatever else SciPy raises on a file that it cannot read.
    """
    try:
        return _reader().submit(_surface, str(path)).result()
    except BrokenProcessPool as error:
        _reader.cache_clear()
        raise ValueError("the process that read it came to an end") from error


@cache
def _reader() -> ProcessPoolExecutor:
    """One process, begun with the first file, for all."""
    return ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=end_with_parent)


def _surface(path: str) -> tuple[np.ndarray, np.ndarray]:
    from scipy.io import loadmat

    for value in loadmat(path, simplify_cells=True).values():
        if isinstance(value, Mapping) and {"X", "Y", "Z", "TRIV"} <= set(value):
            V = np.stack([np.ravel(value[axis]).astype(np.float64) for axis in "XYZ"], axis=1)
            return V, np.atleast_2d(value["TRIV"]).astype(np.int64)
    raise ValueError("it holds no struct with X, Y, Z and TRIV")

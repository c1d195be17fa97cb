"""Lists of numbers in handle files, checked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sshade.errors import InputError


def columns(rows: Sequence[tuple[np.ndarray, ...]]) -> list[np.ndarray]:
    return [np.concatenate(column) for column in zip(*rows, strict=True)]


def as_points(values: Any, what: str) -> np.ndarray:
    return as_array(values, what, (None, 3), "a list of points [x, y, z]")


def as_array(values: Any, what: str, shape: tuple[int | None, ...], form: str) -> np.ndarray:
    """Finite numbers of a shape (None: any length but 0); InputError that tells the form on anything else."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.zeros(0)
    fits = array.ndim == len(shape) and all(a in (None, b) for a, b in zip(shape, array.shape, strict=True))
    if not fits or array.size == 0:
        raise InputError(f"{what} must be {form}")
    if not np.isfinite(array).all():
        raise InputError(f"{what} has a NaN or infinite position")
    return array

"""Convert and check lists of numbers from handle files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sshade.errors import InputError
from sshade.io.packed import require_numbers, unpacked


def columns(rows: Sequence[tuple[np.ndarray, ...]]) -> list[np.ndarray]:
    """Concatenate the first entries of all rows, the second entries, and so on."""
    return [np.concatenate(column) for column in zip(*rows, strict=True)]


def as_ids(values: Any, name: str) -> np.ndarray:
    """Convert a list of vertex ids, or its compact form, to a (k,) int64 array.

    Raises
    ------
    InputError
        When it is no list of integers, or empty.
    """
    values = unpacked(values, name)
    if not isinstance(values, np.ndarray):
        require_numbers(values, name, 1)
    try:
        ids = np.asarray(values)
    except (ValueError, OverflowError):  # lists of several lengths, and integers of many digits
        ids = np.zeros(0)
    if ids.ndim != 1 or ids.size == 0 or ids.dtype.kind != "i":
        raise InputError(f"{name} must be a list of integers, at least one")
    return ids.astype(np.int64)


def as_points(values: Any, name: str) -> np.ndarray:
    """Convert a list of points to a (k, 3) array; see :func:`as_array`."""
    return as_array(values, name, (None, 3), "a list of points [x, y, z]")


def as_boxes(values: Any, name: str) -> np.ndarray:
    """Convert a list of boxes, pairs of their lowest and highest corners, to a (b, 2, 3) array."""
    boxes = as_array(values, name, (None, 2, 3), "a list of pairs of points")
    swapped = np.argwhere(boxes[:, 0] > boxes[:, 1])
    if len(swapped):
        number, axis = swapped[0]
        low, high = boxes[number, :, axis]
        raise InputError(
            f"box {number} of {name} has its corners swapped on axis {'xyz'[axis]}: {low:g} comes before "
            f"{high:g}; the lowest corner comes first"
        )
    return boxes


def as_array(values: Any, name: str, shape: tuple[int | None, ...], form: str) -> np.ndarray:
    """Convert numbers to a float64 array.

    Parameters
    ----------
    values : list or dict
        Lists, or their compact form; see :mod:`sshade.io.packed`.
    name, form : str
        Name of the list and its form, for messages.
    shape : tuple
        None stands for any length but 0.

    Raises
    ------
    InputError
        When the numbers have another shape or are not finite.
    """
    values = unpacked(values, name)
    if not isinstance(values, np.ndarray):
        require_numbers(values, name, len(shape))
    try:
        array = np.asarray(values, dtype=np.float64)
    except OverflowError as error:
        raise InputError(f"{name} has a number that is too large") from error
    except (TypeError, ValueError):
        array = np.zeros(0)
    fits = array.ndim == len(shape) and all(a in (None, b) for a, b in zip(shape, array.shape, strict=True))
    if not fits or array.size == 0:
        raise InputError(f"{name} must be {form}")
    if not np.isfinite(array).all():
        raise InputError(f"{name} has a NaN or infinite position")
    return array

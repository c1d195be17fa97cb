"""Compact forms of long lists of numbers in JSON:

- ``{"runs": [[first, count], ...]}`` stands for ids: ``count`` consecutive ids from each ``first``.
- ``{"base64": "...", "dtype": "<f8", "shape": [k, 3]}`` stands for an array of little-endian numbers.
"""

from __future__ import annotations

import binascii
import json
from base64 import b64decode, b64encode
from math import prod
from typing import Any

import numpy as np

from sshade.core.errors import InputError

#: Greatest number of vertices of a group that is written as a list.
LISTED = 50
#: Types of the numbers of an array.
DTYPES = ("<i4", "<i8", "<f4", "<f8")
#: Greatest number of ids that runs may stand for.
MOST = 100_000_000


def packed(values: np.ndarray) -> Any:
    """Return vertex ids (k,) int64 or points (k, 3) float64 for JSON, bit by bit; long ones are compact."""
    if len(values) <= LISTED:
        return values.tolist()
    integers = values.dtype.kind == "i"
    if integers:
        begin = np.flatnonzero(np.diff(values, prepend=values[0] - 2) != 1)
        count = np.diff(begin, append=len(values))
        runs = {"runs": np.column_stack([values[begin], count]).tolist()}
    dtype = "<f8" if not integers else "<i4" if values.max() < 2**31 else "<i8"
    text = b64encode(values.astype(dtype).tobytes()).decode("ascii")
    array = {"base64": text, "dtype": dtype, "shape": list(values.shape)}
    return runs if integers and len(json.dumps(runs)) < len(json.dumps(array)) else array


def unpacked(values: dict[str, Any], name: str) -> np.ndarray:
    """Return the array of a compact form; raise InputError if it is none. Messages call it `name`."""
    if values.keys() == {"runs"}:
        return _of_runs(values["runs"], name)
    if values.keys() != {"base64", "dtype", "shape"}:
        raise InputError(f'{name} is no list, and has not the keys "base64", "dtype" and "shape"')
    dtype, shape = values["dtype"], values["shape"]
    if dtype not in DTYPES:
        raise InputError(f'the "dtype" of {name} must be one of {", ".join(DTYPES)}')
    if not isinstance(shape, list) or not all(type(length) is int and length >= 0 for length in shape):
        raise InputError(f'the "shape" of {name} must be a list of lengths')
    try:
        content = b64decode(values["base64"], validate=True)
    except (TypeError, ValueError, binascii.Error) as error:
        raise InputError(f'the "base64" of {name} is no base64 text') from error
    if len(content) != prod(shape) * np.dtype(dtype).itemsize:
        raise InputError(f'the "base64" of {name} has {len(content)} bytes, which do not fit its "shape"')
    return np.frombuffer(content, dtype).reshape(shape)


def _of_runs(runs: Any, name: str) -> np.ndarray:
    """Return the ids (k,) of runs [first, count]."""
    pairs = runs if isinstance(runs, list) else []
    whole = all(isinstance(pair, list) and list(map(type, pair)) == [int, int] for pair in pairs)
    if not pairs or not whole or not all(first >= 0 and count > 0 for first, count in pairs):
        raise InputError(f'the "runs" of {name} must be a list of pairs [first id, count]')
    if sum(count for _, count in pairs) > MOST or max(first for first, _ in pairs) >= 2**62:
        raise InputError(f'the "runs" of {name} stand for more than {MOST:,} ids')
    return np.concatenate([np.arange(first, first + count) for first, count in pairs])

"""What a page is sent: facts as JSON, then arrays, so that it need not parse them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

#: Types of arrays that a page can look at as they lie there.
TYPES = ("float32", "uint32", "uint8")


def packet(facts: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> bytes:
    """The length of the JSON as uint32, the JSON, then the arrays, little-endian, each from a multiple of 4.

    Parameters
    ----------
    facts : mapping
    arrays : mapping
        Of one of :data:`TYPES`. The JSON lists them under ``arrays``: name, type, and number of entries.
    """
    listed = [[name, str(array.dtype), array.size] for name, array in arrays.items()]
    assert all(kind in TYPES for _, kind, _ in listed)
    head = json.dumps({**facts, "arrays": listed}, allow_nan=False).encode()
    head += b" " * (-len(head) % 4)
    parts = [len(head).to_bytes(4, "little"), head]
    for array in arrays.values():
        content = array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes()
        parts += [content, b"\0" * (-len(content) % 4)]
    return b"".join(parts)

"""Mutate bytes at random from a seed."""

from collections.abc import Sequence

import numpy as np


def mutated(seeds: Sequence[bytes], tokens: Sequence[bytes], *, number: int) -> bytes:
    """Return a random seed with one to eight random changes. The same `number` gives the same bytes."""
    rng = np.random.default_rng(number)
    data = bytearray(seeds[int(rng.integers(len(seeds)))])
    for _ in range(int(rng.integers(1, 9))):
        at = int(rng.integers(len(data) + 1))
        end = min(len(data), at + int(rng.geometric(0.1)))
        kind = rng.integers(7)
        if kind == 0 and at < len(data):
            data[at] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            data[at:end] = rng.bytes(end - at)
        elif kind == 2:
            del data[at:end]
        elif kind == 3:
            data[at:at] = data[at:end]
        elif kind == 4 and tokens:
            token = tokens[int(rng.integers(len(tokens)))]
            data[at : at + len(token) * int(rng.integers(2))] = token
        elif kind == 5:
            other = seeds[int(rng.integers(len(seeds)))]
            start = int(rng.integers(len(other) + 1))
            data[at:end] = other[start : start + int(rng.geometric(0.02))]
        elif kind == 6 and rng.integers(4) == 0:
            del data[at:]
    return bytes(data)

"""Read and write float64 numbers in texts, about as fast as memory allows.

Words are read to the nearest double. Doubles are written as ``repr`` writes them: the shortest decimals that
read back as the same double. NumPy writes the same bytes in 4 times the time. A text is a (b,) uint8 array
and a word is given by two places, as in :mod:`sshade.io.words`.

R. Giulietti, "The Schubfach way to render doubles", 2020.
D. Lemire, "Number parsing at a gigabyte per second", Software: Practice and Experience 51(8), 2021.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from sshade.io.words import Lines, array_of, columns_of, line_number

#: Kinds of :class:`Edits`: what is inserted.
NOTHING, DOUBLE, INTEGER = 0, 1, 2
#: Greatest length of a number in bytes.
_LONGEST = 32
#: Least and greatest power of ten in the table.
_LEAST, _GREATEST = -348, 347


def _powers() -> np.ndarray:
    """Return a (k, 2) uint64 table: the first 128 bits of each power of ten, rounded down."""
    rows = []
    for e in range(_LEAST, _GREATEST + 1):
        if e >= 0:
            bits = (10**e).bit_length()
            x = 10**e << 128 >> bits
        else:
            x = (1 << ((10**-e).bit_length() + 127)) // 10**-e
            x >>= x.bit_length() - 128
        rows.append((x >> 64, x & (2**64 - 1)))
    return np.array(rows, dtype=np.uint64)


_POWERS = _powers()


def numbers_of(text: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Read words as float64; the result has the shape of `begin`.

    Raises
    ------
    ValueError
        When a word is no number.
    """
    shape = begin.shape
    begin, end = np.ascontiguousarray(begin).ravel(), np.ascontiguousarray(end).ravel()
    values, other = _parsed(text, begin, end)
    # The kernel leaves numbers of more than 19 digits, nan, inf and mistakes to Python.
    for i in np.flatnonzero(other).tolist():
        values[i] = float(text[begin[i] : end[i]].tobytes())
    return values.reshape(shape)


class Edits(NamedTuple):
    """Changes of a text, five (e,) arrays. Each change replaces a part of the text by a number.

    Attributes
    ----------
    where : int64
        Sorting key: changes are made in ascending order; equal keys keep their order.
    stop : int64
        Place up to which the text is copied before the number.
    resume : int64
        Place from which copying goes on behind the number. It may lie before `stop`.
    kind : uint8
        NOTHING, DOUBLE or INTEGER.
    value : float64
        The number.
    """

    where: np.ndarray
    stop: np.ndarray
    resume: np.ndarray
    kind: np.ndarray
    value: np.ndarray


class Numbers(NamedTuple):
    """Numbers of a text and the places of their words, three arrays of one shape."""

    begin: np.ndarray
    end: np.ndarray
    value: np.ndarray

    def edits(self, new: np.ndarray, *, kind: int = DOUBLE) -> Edits:
        """Return the edits that write `new`; words whose number stays keep their bytes."""
        changed = self.value != new
        if changed.all():  # the usual case, without copies
            begin, end, new = self.begin.ravel(), self.end.ravel(), new.ravel()
        else:
            begin, end, new = self.begin[changed], self.end[changed], new[changed]
        kinds = np.full(len(begin), kind, dtype=np.uint8)
        return Edits(begin, begin, end, kinds, new.astype(np.float64, copy=False))


def vectors_of(text: np.ndarray, lines: Lines, first: int, name: str) -> tuple[Numbers, np.ndarray]:
    """Read three numbers of each line, from word `first` on.

    Returns
    -------
    numbers : Numbers
        Arrays of shape (l, 3).
    words : (l,) int64
        Number of all words of each line.

    Raises
    ------
    ValueError
        When a line has too few words, or one of them is no number.
    """
    begin, end, words = columns_of(text, lines.begin, lines.end, first, 3)
    short = np.flatnonzero(words < first + 3)
    if len(short):
        number = line_number(text, lines.begin[short[0]])
        raise ValueError(f"line {number}: {name} needs three coordinates")
    return Numbers(begin, end, numbers_of(text, begin, end)), words


def edited(text: np.ndarray, edits: list[Edits], *, size: int | None = None) -> bytes:
    """Return the first `size` bytes of a text, by default all, with edits."""
    where, *changes = edits[0] if len(edits) == 1 else map(np.concatenate, zip(*edits, strict=True))
    ascending = (where[1:] >= where[:-1]).all()
    order = np.arange(len(where)) if ascending else np.argsort(where, kind="stable")
    return _with_edits(text, order, changes, len(text) if size is None else size)


def rows_of(prefix: bytes, values: np.ndarray, kind: int = DOUBLE) -> bytes:
    """Write a line for each row of numbers (k, d): the prefix, then a blank before each number."""
    text, (k, d) = array_of(b"\n" + prefix + b" "), values.shape
    # Each edit copies a blank, or for the first number of a row the line end and the prefix.
    stop, resume = np.full((k, d), len(text)), np.full((k, d), len(text) - 1)
    stop[:, 0] -= not prefix
    resume[:, -1] = 0
    kinds, values = np.full(k * d, kind, dtype=np.uint8), values.astype(np.float64).ravel()
    return _with_edits(text, np.arange(k * d), [stop.ravel(), resume.ravel(), kinds, values], 1)[1:]


def _with_edits(text: np.ndarray, order: np.ndarray, changes: list[np.ndarray], size: int) -> bytes:
    stop, resume, kind, _ = changes
    room = size + int(stop.sum()) - int(resume.sum()) + _LONGEST * int(np.count_nonzero(kind))
    out = np.empty(room, dtype=np.uint8)
    return out[: _edited(text, order, *changes, size, out)].tobytes()


# The helpers are inlined, because each call would count references to the arrays.


@njit(inline="always")
def _product(a, b):
    """Return the high and the low half of the product of two uint64."""
    mask = np.uint64(0xFFFFFFFF)
    half = np.uint64(32)
    a0, a1, b0, b1 = a & mask, a >> half, b & mask, b >> half
    low, left, right, high = a0 * b0, a1 * b0, a0 * b1, a1 * b1
    middle = (low >> half) + (left & mask) + right
    return high + (left >> half) + (middle >> half), (middle << half) | (low & mask)


@njit(cache=True, nogil=True)
def _nearest(digits, e):
    """Return the bits of the double nearest to digits x 10^e (Eisel, Lemire), and whether it is certain."""
    none = np.uint64(0)
    if digits == 0:
        return none, True
    if e < _LEAST or e > _GREATEST:
        return none, False
    zeros = 0
    while digits >> np.uint64(63) == 0:
        digits <<= np.uint64(1)
        zeros += 1
    exponent = ((217706 * e) >> 16) + 64 + 1023 - zeros
    high, low = _product(digits, _POWERS[e - _LEAST, 0])
    rest = np.uint64(0x1FF)
    if high & rest == rest and low + digits < digits:
        more, least = _product(digits, _POWERS[e - _LEAST, 1])
        merged = low + more
        if merged < low:
            high += np.uint64(1)
        low = merged
        if high & rest == rest and low + np.uint64(1) == 0 and least + digits < digits:
            return none, False
    top = high >> np.uint64(63)
    mantissa = high >> (top + np.uint64(9))
    exponent -= 1 - np.int64(top)
    if low == 0 and high & rest == 0 and mantissa & np.uint64(3) == 1:
        return none, False  # half way between two doubles
    mantissa = (mantissa + (mantissa & np.uint64(1))) >> np.uint64(1)
    if mantissa >> np.uint64(53) > 0:
        mantissa >>= np.uint64(1)
        exponent += 1
    if exponent < 1 or exponent >= 0x7FF:
        return none, False
    return (np.uint64(exponent) << np.uint64(52)) | (mantissa & np.uint64(0xFFFFFFFFFFFFF)), True


@njit(cache=True, nogil=True)
def _parsed(text, begin, end):
    """Return the values of plain decimals with at most 19 digits, and which words are something else."""
    values, other = np.zeros(len(begin), dtype=np.uint64), np.zeros(len(begin), dtype=np.bool_)
    for i in range(len(begin)):
        p, stop = begin[i], end[i]
        negative = p < stop and text[p] == 45
        if p < stop and (text[p] == 45 or text[p] == 43):
            p += 1
        digits, significant, read, e, point = np.uint64(0), 0, 0, 0, False
        while p < stop:
            d = np.int64(text[p]) - 48
            if 0 <= d <= 9:
                digits = digits * np.uint64(10) + np.uint64(d)
                significant += significant > 0 or d > 0
                read += 1
                e -= point
            elif text[p] == 46 and not point:
                point = True
            else:
                break
            p += 1
        sound = read > 0 and significant <= 19
        if sound and p < stop and (text[p] == 101 or text[p] == 69):
            p += 1
            minus = p < stop and text[p] == 45
            if p < stop and (text[p] == 45 or text[p] == 43):
                p += 1
            sound, power = p < stop, 0
            while p < stop and 0 <= np.int64(text[p]) - 48 <= 9 and power < 10000:
                power = 10 * power + np.int64(text[p]) - 48
                p += 1
            e += -power if minus else power
        sound = sound and p == stop
        if sound:
            values[i], sound = _nearest(digits, e)
            values[i] |= np.uint64(negative) << np.uint64(63)
        other[i] = not sound
    return values.view(np.float64), other


@njit(cache=True, nogil=True)
def _to_odd(high, low, factor):
    """Multiply a 128-bit by a 64-bit number and divide by 2^128; set the last bit if there is a remainder."""
    carried, _ = _product(low, factor)
    top, middle = _product(high, factor)
    total = middle + carried
    if total < middle:
        top += np.uint64(1)
    return top | np.uint64(total > 1)


@njit(cache=True, nogil=True)
def _shortest(pattern):
    """Return digits and exponent of the shortest decimal of a positive double from its bits (Schubfach)."""
    one, four = np.uint64(1), np.uint64(4)
    fraction = pattern & np.uint64(0xFFFFFFFFFFFFF)
    biased = np.int64(pattern >> np.uint64(52)) & 0x7FF
    c, q = (fraction | (one << np.uint64(52)), biased - 1075) if biased else (fraction, -1074)
    odd = c & one
    closer = fraction == 0 and biased > 1
    k = (q * 1262611 - (524031 if closer else 0)) >> 22
    shift = np.uint64(q + ((-k * 1741647) >> 19) + 1)
    high, low = _POWERS[-k - _LEAST, 0], _POWERS[-k - _LEAST, 1]
    if -k < 0 or -k > 55:  # the entry is not exact: round it up
        low += one
        high += np.uint64(low == 0)
    below = _to_odd(high, low, (four * c - np.uint64(1 if closer else 2)) << shift) + odd
    here = _to_odd(high, low, (four * c) << shift)
    above = _to_odd(high, low, (four * c + np.uint64(2)) << shift) - odd
    s = here >> np.uint64(2)
    if s >= 10:
        tens = s // np.uint64(10)
        under, over = below <= np.uint64(40) * tens, np.uint64(40) * tens + np.uint64(40) <= above
        if under != over:
            return tens + np.uint64(over), k + 1
    under, over = below <= four * s, four * s + four <= above
    if under != over:
        return s + np.uint64(over), k
    middle = four * s + np.uint64(2)
    return s + np.uint64(here > middle or (here == middle and s & one == 1)), k


@njit(inline="always")
def _write_digits(out, p, digits, count):
    for i in range(count):
        out[p + count - 1 - i] = 48 + digits % np.uint64(10)
        digits //= np.uint64(10)
    return p + count


@njit(cache=True, nogil=True)
def _count_digits(digits):
    count = 1
    while digits >= 10:
        digits //= np.uint64(10)
        count += 1
    return count


@njit(cache=True, nogil=True)
def _write_double(out, p, pattern):
    """Write a double at place `p` of `out` as ``repr`` does; return the place behind the number."""
    infinite, size = np.uint64(0x7FF) << np.uint64(52), pattern & np.uint64(0x7FFFFFFFFFFFFFFF)
    if size < pattern and size <= infinite:
        out[p] = 45
        p += 1
    pattern = size
    if pattern >= infinite:
        letters = (105, 110, 102) if pattern == infinite else (110, 97, 110)
        for i in range(3):
            out[p + i] = letters[i]
        return p + 3
    digits, e = (np.uint64(0), 0) if pattern == 0 else _shortest(pattern)
    while digits >= 10 and digits % np.uint64(10) == 0:
        digits //= np.uint64(10)
        e += 1
    count = _count_digits(digits)
    point = count + e if digits else 1  # digits before the decimal point
    if -4 < point <= 16:
        if point <= 0:
            out[p], out[p + 1] = 48, 46
            p += 2
            for _ in range(-point):
                out[p] = 48
                p += 1
            return _write_digits(out, p, digits, count)
        if count <= point:
            p = _write_digits(out, p, digits, count)
            for _ in range(point - count):
                out[p] = 48
                p += 1
            out[p], out[p + 1] = 46, 48
            return p + 2
        _write_digits(out, p + 1, digits, count)
        for i in range(point):
            out[p + i] = out[p + i + 1]
        out[p + point] = 46
        return p + count + 1
    _write_digits(out, p + 1, digits, count)
    out[p] = out[p + 1]
    out[p + 1] = 46
    p += count + 1 if count > 1 else 1
    out[p], out[p + 1] = 101, 45 if point < 1 else 43
    power = np.uint64(abs(point - 1))
    return _write_digits(out, p + 2, power, max(2, _count_digits(power)))


@njit(cache=True, nogil=True)
def _edited(text, order, stop, resume, kind, value, size, out):
    patterns, p, q = value.view(np.uint64), 0, 0
    for i in order:
        while q < stop[i]:
            out[p] = text[q]
            p, q = p + 1, q + 1
        q = resume[i]
        if kind[i] == DOUBLE:
            p = _write_double(out, p, patterns[i])
        elif kind[i] == INTEGER:
            whole = np.int64(value[i])
            if whole < 0:
                out[p] = 45
                p += 1
            length = np.uint64(abs(whole))
            p = _write_digits(out, p, length, _count_digits(length))
    while q < size:
        out[p] = text[q]
        p, q = p + 1, q + 1
    return p

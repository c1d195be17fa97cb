"""Text of numbers at the speed of memory: where words stand, what they say, and texts with other numbers.

A text is a (b,) uint8 array; a word is given by the place of its first byte and the place behind its
last one. Numbers are read to the nearest double and written as the shortest decimals that read back as the
same double, the nearest of these, laid out as Python does: the bytes are those of ``repr``.

R. Giulietti, "The Schubfach way to render doubles", 2020.
D. Lemire, "Number parsing at a gigabyte per second", Software: Practice and Experience 51(8), 2021.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

#: What an edit puts into a text.
NOTHING, DOUBLE, INTEGER = 0, 1, 2
#: Longest text of a number.
_LONGEST = 32
#: Powers of ten in the tables.
_LEAST, _GREATEST = -348, 347
_NEWLINE, _RETURN, _BACKSLASH = 10, 13, 92


def _powers() -> np.ndarray:
    """(k, 2) uint64: the first 128 bits of 10^e, rounded down, for e from the least to the greatest."""
    rows = []
    for e in range(_LEAST, _GREATEST + 1):
        if e >= 0:
            x = 10**e
            bits = x.bit_length()
            x = x << (128 - bits) if bits <= 128 else x >> (bits - 128)
        else:
            x = 10**-e
            x = (1 << (x.bit_length() + 127)) // x
            x >>= x.bit_length() - 128
        rows.append((x >> 64, x & (2**64 - 1)))
    return np.array(rows, dtype=np.uint64)


_POWERS = _powers()


class Lines(NamedTuple):
    """Lines of a text, without their ends: (l,) int64 each.

    Attributes
    ----------
    begin, end : arrays
        Of the line; a comment is no part of it.
    key : array
        The first eight bytes of its first word, the first one lowest; 0 where it has no word.
    """

    begin: np.ndarray
    end: np.ndarray
    key: np.ndarray

    def of(self, which: np.ndarray | slice) -> Lines:
        """Some of the lines."""
        return Lines(*(column[which] for column in self))


def key_of(word: bytes) -> int:
    """The key of lines that begin with a word of eight bytes at most."""
    return int.from_bytes(word.ljust(8, b"\0"), "little")


def array_of(data: bytes) -> np.ndarray:
    """(b,) uint8 of a text."""
    return np.frombuffer(data, np.uint8)


def joined(text: np.ndarray) -> np.ndarray:
    """The text with blanks for each backslash at the end of a line and that end, which joins the next one."""
    places = np.flatnonzero(text[:-1] == _BACKSLASH) if len(text) else np.zeros(0, dtype=np.int64)
    plain = places[text[places + 1] == _NEWLINE]
    wide = places[(text[places + 1] == _RETURN) & (places + 2 < len(text))]
    wide = wide[text[wide + 2] == _NEWLINE]
    if not len(plain) + len(wide):
        return text
    text = text.copy()
    for place, size in ((plain, 2), (wide, 3)):
        text[place[:, None] + np.arange(size)] = 32
    return text


def lines_of(text: np.ndarray, *, comment: bytes = b"\0", fold: bool = False) -> Lines:
    r"""Find the lines, which end in ``\n``, ``\r`` or both.

    Parameters
    ----------
    text : (b,) uint8
    comment : bytes
        What begins a comment, which is no part of its line; by default nothing.
    fold : bool
        Keys are in small letters.
    """
    breaks = np.flatnonzero((text == _NEWLINE) | (text == _RETURN))
    after = breaks + 1
    if len(breaks):
        returned = text[breaks] == _RETURN
        # The newline behind a return is of the same end.
        second = np.append(False, returned[:-1] & ~returned[1:] & (breaks[1:] == after[:-1]))
        ended = np.append(second[1:], False)
        after[ended] += 1
        breaks, after = breaks[~second], after[~second]
    begin, end = np.append(0, after), np.append(breaks, len(text))
    if begin[-1] == len(text):
        begin, end = begin[:-1], end[:-1]
    return Lines(begin, *_first_words(text, begin, end, comment[0], fold))


def words_of(text: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(w,) int64 begins and ends of all words."""
    return _words(text, np.zeros(1, dtype=np.int64), np.full(1, len(text)), 0)[:2]


def words_in(text: np.ndarray, lines: Lines, first: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All words of each line from number `first` on.

    Returns
    -------
    begin, end : (w,) int64
    words : (l,) int64
        How many of them are of each line.
    """
    return _words(text, lines.begin, lines.end, first)


def columns_of(text: np.ndarray, lines: Lines, first: int, count: int) -> tuple[np.ndarray, ...]:
    """Words `first` to `first` + `count` of each line.

    Returns
    -------
    begin, end : (l, count) int64
        Both are the end of the line where it has no such word.
    words : (l,) int64
        How many words each line has in all.
    """
    return _columns(text, lines.begin, lines.end, first, count)


def numbers_of(text: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The doubles that words say, of the shape of `begin`.

    Raises
    ------
    ValueError
        When a word is no number.
    """
    shape = begin.shape
    begin, end = np.ascontiguousarray(begin).ravel(), np.ascontiguousarray(end).ravel()
    values, other = _parsed(text, begin, end)
    for i in np.flatnonzero(other).tolist():  # more digits than 19, nan, inf, and what is no number
        values[i] = float(text[begin[i] : end[i]].tobytes())
    return values.reshape(shape)


def integers_of(text: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The whole numbers that words say, int64; ValueError when one is none."""
    shape = begin.shape
    begin, end = np.ascontiguousarray(begin).ravel(), np.ascontiguousarray(end).ravel()
    values, wrong = _integers(text, begin, end)
    if wrong >= 0:
        word = text[begin[wrong] : end[wrong]].tobytes().decode("latin-1")
        raise ValueError(f"{word[:60]!r} is no whole number")
    return values.reshape(shape)


def parts_of(
    text: np.ndarray, begin: np.ndarray, end: np.ndarray, number: int
) -> tuple[np.ndarray, np.ndarray]:
    """Begins and ends of what stands in words (w,) behind so many slashes; both are the end if none does."""
    return _parts(text, begin, end, number)


class Edits(NamedTuple):
    """Changes of a text (e,): up to `stop` it is copied, a number follows, and it goes on elsewhere.

    Attributes
    ----------
    where : int64
        They are made in this order, and as they stand where it is the same.
    stop, resume : int64
        Where copying ends, and goes on.
    kind : uint8
        NOTHING, DOUBLE or INTEGER.
    value : float64
    """

    where: np.ndarray
    stop: np.ndarray
    resume: np.ndarray
    kind: np.ndarray
    value: np.ndarray


def edited(text: np.ndarray, edits: list[Edits], *, size: int | None = None) -> bytes:
    """The first `size` bytes of a text, by default all, with edits."""
    where, *changes = edits[0] if len(edits) == 1 else map(np.concatenate, zip(*edits, strict=True))
    ascending = (where[1:] >= where[:-1]).all()
    order = np.arange(len(where)) if ascending else np.argsort(where, kind="stable")
    return _with_edits(text, order, changes, len(text) if size is None else size)


def rows_of(prefix: bytes, values: np.ndarray, kind: int = DOUBLE) -> bytes:
    """Lines of a text: some bytes, then a row of numbers (k, d), a blank before each."""
    text, (k, d) = array_of(b"\n" + prefix + b" "), values.shape
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


def numbers_edited(
    begin: np.ndarray, end: np.ndarray, old: np.ndarray, new: np.ndarray, *, kind: int = DOUBLE
) -> Edits:
    """Edits that give words other numbers, arrays of one shape; those whose number stays keep their bytes."""
    changed = old != new
    if changed.all():  # the usual case, without copies
        begin, end, new = begin.ravel(), end.ravel(), new.astype(np.float64, copy=False).ravel()
    else:
        begin, end, new = begin[changed], end[changed], new[changed].astype(np.float64)
    return Edits(begin, begin, end, np.full(len(begin), kind, dtype=np.uint8), new)


# Called for every word or number: inlined, as a call would count the references of each array anew.


@njit(inline="always")
def _is_space(byte):
    return byte <= 32 and (byte == 32 or 9 <= byte <= 13)


@njit(inline="always")
def _next_word(text, p, end):
    """Where the next word begins and ends; both are `end` if there is none."""
    while p < end and _is_space(text[p]):
        p += 1
    start = p
    while p < end and not _is_space(text[p]):
        p += 1
    return start, p


@njit(cache=True, nogil=True)
def _first_words(text, begin, end, comment, fold):
    """Ends of the lines without their comments, and their keys."""
    stop, key = end.copy(), np.zeros(len(end), dtype=np.int64)
    for i in range(len(begin)):
        if comment != 0:
            for p in range(begin[i], end[i]):
                if text[p] == comment:
                    stop[i] = p
                    break
        word, behind = _next_word(text, begin[i], stop[i])
        for k in range(min(8, behind - word)):
            byte = np.int64(text[word + k])
            key[i] |= (byte | 32 if fold and 65 <= byte <= 90 else byte) << (8 * k)
    return stop, key


@njit(cache=True, nogil=True)
def _words(text, begin, end, first):
    most = 0
    for i in range(len(begin)):
        most += (end[i] - begin[i] + 1) // 2
    start, stop = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64)
    words, count = np.zeros(len(begin), dtype=np.int64), 0
    for i in range(len(begin)):
        p, number = begin[i], 0
        while True:
            q, p = _next_word(text, p, end[i])
            if q == p:
                break
            if number >= first:
                start[count], stop[count] = q, p
                count += 1
            number += 1
        words[i] = max(number - first, 0)
    return start[:count].copy(), stop[:count].copy(), words


@njit(cache=True, nogil=True)
def _columns(text, begin, end, first, count):
    size = len(begin)
    start, stop = np.empty((size, count), dtype=np.int64), np.empty((size, count), dtype=np.int64)
    words = np.zeros(size, dtype=np.int64)
    for i in range(size):
        start[i], stop[i] = end[i], end[i]
        p, number = begin[i], 0
        while True:
            q, p = _next_word(text, p, end[i])
            if q == p:
                break
            if first <= number < first + count:
                start[i, number - first], stop[i, number - first] = q, p
            number += 1
        words[i] = number
    return start, stop, words


@njit(cache=True, nogil=True)
def _parts(text, begin, end, number):
    start, stop = end.copy(), end.copy()
    for i in range(len(begin)):
        p, slashes = begin[i], 0
        while p < end[i] and slashes < number:
            slashes += text[p] == 47
            p += 1
        if slashes == number:
            start[i] = p
            while p < end[i] and text[p] != 47:
                p += 1
            stop[i] = p
    return start, stop


@njit(cache=True, nogil=True)
def _integers(text, begin, end):
    """Values of words of 18 digits at most, and the first one that is another, or -1."""
    values = np.empty(len(begin), dtype=np.int64)
    for i in range(len(begin)):
        p, size = begin[i], 0
        negative = p < end[i] and text[p] == 45
        if p < end[i] and (text[p] == 45 or text[p] == 43):
            p += 1
        if p == end[i] or end[i] - p > 18:
            return values, i
        while p < end[i]:
            d = np.int64(text[p]) - 48
            if d < 0 or d > 9:
                return values, i
            size = 10 * size + d
            p += 1
        values[i] = -size if negative else size
    return values, -1


@njit(inline="always")
def _product(a, b):
    """High and low halves of the product of two uint64."""
    mask = np.uint64(0xFFFFFFFF)
    half = np.uint64(32)
    a0, a1, b0, b1 = a & mask, a >> half, b & mask, b >> half
    low, left, right, high = a0 * b0, a1 * b0, a0 * b1, a1 * b1
    middle = (low >> half) + (left & mask) + right
    return high + (left >> half) + (middle >> half), (middle << half) | (low & mask)


@njit(cache=True, nogil=True)
def _nearest(digits, e):
    """Bits of the double nearest to digits x 10^e (Eisel and Lemire), and whether that is certain."""
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
        return none, False  # half way between two
    mantissa = (mantissa + (mantissa & np.uint64(1))) >> np.uint64(1)
    if mantissa >> np.uint64(53) > 0:
        mantissa >>= np.uint64(1)
        exponent += 1
    if exponent < 1 or exponent >= 0x7FF:
        return none, False
    return (np.uint64(exponent) << np.uint64(52)) | (mantissa & np.uint64(0xFFFFFFFFFFFFF)), True


@njit(cache=True, nogil=True)
def _parsed(text, begin, end):
    """Values of plain decimals of 19 digits at most, and which words are others."""
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
    """The product of a 128-bit number and a 64-bit one over 2^128, its last bit set if there is a rest."""
    carried, _ = _product(low, factor)
    top, middle = _product(high, factor)
    total = middle + carried
    if total < middle:
        top += np.uint64(1)
    return top | np.uint64(total > 1)


@njit(cache=True, nogil=True)
def _shortest(pattern):
    """Digits and exponent of the shortest decimal of a positive double, given by its bits (Schubfach)."""
    one, four = np.uint64(1), np.uint64(4)
    fraction = pattern & np.uint64(0xFFFFFFFFFFFFF)
    biased = np.int64(pattern >> np.uint64(52)) & 0x7FF
    c, q = (fraction | (one << np.uint64(52)), biased - 1075) if biased else (fraction, -1074)
    odd = c & one
    closer = fraction == 0 and biased > 1
    k = (q * 1262611 - (524031 if closer else 0)) >> 22
    shift = np.uint64(q + ((-k * 1741647) >> 19) + 1)
    high, low = _POWERS[-k - _LEAST, 0], _POWERS[-k - _LEAST, 1]
    if -k < 0 or -k > 55:  # rounded up
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
    """Write a double at place p of `out` as Python's repr does, and return the place behind it."""
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

"""Split a text into lines, words and whole numbers, at the speed of memory.

A text is a (b,) uint8 array. A word is given by two places: its first byte, and the byte behind its last.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

_NEWLINE, _RETURN = 10, 13


class Lines(NamedTuple):
    """Lines of a text: three (l,) int64 arrays.

    Attributes
    ----------
    begin, end : arrays
        Places where each line begins and ends, without line end and comment.
    key : array
        First eight bytes of the first word, the first byte lowest; 0 for a line without words.
    """

    begin: np.ndarray
    end: np.ndarray
    key: np.ndarray

    def of(self, chosen: np.ndarray | slice) -> Lines:
        """Return some of the lines."""
        return Lines(*(column[chosen] for column in self))


def key_of(word: bytes) -> int:
    """Return the key of lines that begin with `word`, which has at most eight bytes."""
    return int.from_bytes(word.ljust(8, b"\0"), "little")


def array_of(data: bytes) -> np.ndarray:
    """Return the (b,) uint8 array of a text."""
    return np.frombuffer(data, np.uint8)


def line_number(text: np.ndarray, place: int) -> int:
    """Return the number of the line that contains a place, counted from 1, for messages."""
    before = text[:place].tobytes()
    return max(before.count(b"\n"), before.count(b"\r")) + 1


def lines_of(text: np.ndarray, *, comment: bytes = b"\0", fold: bool = False) -> Lines:
    r"""Find the lines, which end in ``\n``, ``\r`` or ``\r\n``.

    Parameters
    ----------
    text : (b,) uint8
    comment : bytes
        Character that begins a comment. By default no character does.
    fold : bool
        Convert keys to lower case.
    """
    newlines, returns = text == _NEWLINE, text == _RETURN
    has_returns = returns.any()
    breaks = np.flatnonzero(newlines | returns if has_returns else newlines)
    after = breaks + 1
    if has_returns:
        returned = text[breaks] == _RETURN
        # A newline directly behind a return belongs to the same line end.
        second = np.append(False, returned[:-1] & ~returned[1:] & (breaks[1:] == after[:-1]))
        after[np.append(second[1:], False)] += 1
        breaks, after = breaks[~second], after[~second]
    begin, end = np.append(0, after), np.append(breaks, len(text))
    if begin[-1] == len(text):
        begin, end = begin[:-1], end[:-1]
    return Lines(begin, *_first_words(text, begin, end, comment[0], fold))


def words_of(text: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the places where all words begin and end, (w,) int64 each."""
    return words_in(text, np.zeros(1, dtype=np.int64), np.full(1, len(text)), 0)[:2]


def integers_of(text: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Read words as int64.

    Raises
    ------
    ValueError
        When a word is not a whole number of at most 18 digits.
    """
    values, wrong = _integers(text, np.ascontiguousarray(begin).ravel(), np.ascontiguousarray(end).ravel())
    if wrong >= 0:
        word = text[begin.flat[wrong] : end.flat[wrong]].tobytes().decode("latin-1")
        raise ValueError(f"{word[:60]!r} is no whole number")
    return values.reshape(begin.shape)


# The helpers are inlined, because each call would count references to the arrays.


@njit(inline="always")
def _is_space(byte):
    return byte <= 32 and (byte == 32 or 9 <= byte <= 13)


@njit(inline="always")
def _next_word(text, p, end):
    """Find the next word from place `p` on; both results are `end` if there is none."""
    while p < end and _is_space(text[p]):
        p += 1
    start = p
    while p < end and not _is_space(text[p]):
        p += 1
    return start, p


@njit(cache=True, nogil=True)
def _first_words(text, begin, end, comment, fold):
    """Return the ends of the lines without comments, and the keys."""
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
def words_in(text, begin, end, first):
    """Find the words of each line from number `first` on.

    Returns
    -------
    start, stop : (w,) int64
        Places of the words, line by line.
    count : (l,) int64
        Number of found words in each line.
    """
    most = 0
    for i in range(len(begin)):
        most += (end[i] - begin[i] + 1) // 2
    start, stop = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64)
    count, total = np.zeros(len(begin), dtype=np.int64), 0
    for i in range(len(begin)):
        p, number = begin[i], 0
        while True:
            q, p = _next_word(text, p, end[i])
            if q == p:
                break
            if number >= first:
                start[total], stop[total] = q, p
                total += 1
            number += 1
        count[i] = max(number - first, 0)
    return start[:total].copy(), stop[:total].copy(), count


@njit(cache=True, nogil=True)
def columns_of(text, begin, end, first, columns):
    """Find the words with numbers `first` to `first` + `columns` of each line.

    Returns
    -------
    start, stop : (l, columns) int64
        Places of the words. Both are the end of the line where it has too few words.
    count : (l,) int64
        Number of all words of each line.
    """
    size = len(begin)
    start, stop = np.empty((size, columns), dtype=np.int64), np.empty((size, columns), dtype=np.int64)
    count = np.zeros(size, dtype=np.int64)
    for i in range(size):
        start[i], stop[i] = end[i], end[i]
        p, number = begin[i], 0
        while True:
            q, p = _next_word(text, p, end[i])
            if q == p:
                break
            if first <= number < first + columns:
                start[i, number - first], stop[i, number - first] = q, p
            number += 1
        count[i] = number
    return start, stop, count


@njit(cache=True, nogil=True)
def parts_of(text, begin, end, slashes):
    """Find the part of each word behind a number of slashes; both places are the end if there is none."""
    start, stop = end.copy(), end.copy()
    for i in range(len(begin)):
        p, passed = begin[i], 0
        while p < end[i] and passed < slashes:
            passed += text[p] == 47
            p += 1
        if passed == slashes:
            start[i] = p
            while p < end[i] and text[p] != 47:
                p += 1
            stop[i] = p
    return start, stop


@njit(cache=True, nogil=True)
def _integers(text, begin, end):
    """Return the values of words with at most 18 digits, and the number of the first other word or -1."""
    values = np.empty(len(begin), dtype=np.int64)
    for i in range(len(begin)):
        p, size = begin[i], 0
        negative = p < end[i] and text[p] == 45
        if p < end[i] and (text[p] == 45 or text[p] == 43):
            p += 1
        if p == end[i] or end[i] - p > 18:
            return values, i
        while p < end[i]:
            digit = np.int64(text[p]) - 48
            if digit < 0 or digit > 9:
                return values, i
            size = 10 * size + digit
            p += 1
        values[i] = -size if negative else size
    return values, -1

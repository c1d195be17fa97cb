"""Words of a text at the speed of memory: where lines and words stand, and the whole numbers that they say.

A text is a (b,) uint8 array; a word is given by the place of its first byte and the place behind its
last one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

_NEWLINE, _RETURN, _BACKSLASH = 10, 13, 92


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
    ends, returns = text == _NEWLINE, text == _RETURN
    returns_there = returns.any()
    breaks = np.flatnonzero(ends | returns if returns_there else ends)
    after = breaks + 1
    if returns_there:
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

"""Read and change the numbers of a text.

Numbers are read to the nearest double and written as ``repr`` writes them: the shortest decimals that read
back as the same double.
"""

from __future__ import annotations

import re
import warnings
from typing import NamedTuple

import numpy as np

#: The byte-order mark of UTF-8, with which programs of Windows begin a text.
BOM = b"\xef\xbb\xbf"
_BLANK = 32
_INTEGER = re.compile(rb"[+-]?[0-9]{1,18}")
#: How programs of Windows write a number that is none, such as the normal of a face without area.
_NAN = re.compile(rb"[+-]?(nan\([a-z]*\)|1\.#(ind|qnan|snan)[0-9]*)", re.IGNORECASE)


class Edits(NamedTuple):
    """Parts of a text from byte `begin` to byte `end`, (e,) int64 each, and e texts that replace them."""

    begin: np.ndarray
    end: np.ndarray
    replacements: list[str]


class Numbers(NamedTuple):
    """Numbers of a text: the bytes where they begin and end, and their values, three arrays of one shape."""

    begin: np.ndarray
    end: np.ndarray
    value: np.ndarray

    def edits(self, new: np.ndarray) -> Edits:
        """Return the edits that write `new`; numbers that stay keep their bytes."""
        changed = (self.value != new) & ~(np.isnan(self.value) & np.isnan(new))
        return Edits(self.begin[changed], self.end[changed], list(map(repr, new[changed].tolist())))


class Text:
    r"""Words of a text, line by line. Lines end in ``\n`` or ``\r\n``; empty lines do not count.

    In a text without ``\n``, lines end in ``\r`` alone, as on old Macintosh computers.

    A byte-order mark at the beginning belongs to no word.

    Parameters
    ----------
    data : bytes
    above : int
        Number of lines before the text in its file, for messages.

    Attributes
    ----------
    data, newline : bytes
    begin, end : (w,) int64
        Bytes where each word begins and ends.
    first, size : (l,) int64
        Number of the first word of each line, and how many words the line has.
    """

    def __init__(self, data: bytes, *, above: int = 0) -> None:
        self.data, self._above = data, above
        self.newline = b"\n" if b"\n" in data else b"\r"
        self._bytes = np.frombuffer(data, np.uint8)
        space = np.ones(len(data) + 2, dtype=bool)
        # 9 to 13 are tab, line ends and form feed; smaller numbers wrap around.
        space[1:-1] = (self._bytes - np.uint8(9) < 5) | (self._bytes == _BLANK)
        if data.startswith(BOM):
            space[1:4] = True
        edges = np.flatnonzero(space[1:] != space[:-1])
        self.begin, self.end = edges[::2], edges[1::2]
        breaks = np.flatnonzero(self._bytes == ord(self.newline))
        self._breaks = np.concatenate([[-1], breaks, [len(data) - 1]])
        starts = np.searchsorted(self.begin, self._breaks[:-1])
        nonempty = np.append(starts[1:] > starts[:-1], starts[-1] < len(self.begin))
        self.first = starts[nonempty]
        self.size = np.diff(self.first, append=len(self.begin))

    def keys(self, *, fold: bool = False) -> np.ndarray:
        """Return the keys (l,) of the first words of all lines; with `fold`, in lower case."""
        padded = (self.data.lower() if fold else self.data) + bytes(8)
        eight = np.ndarray(len(self.data), "<u8", padded, strides=(1,))  # the eight bytes from each place on
        length = np.minimum(self.end[self.first] - self.begin[self.first], 8)
        masks = np.array([key_of(b"\xff" * k) for k in range(9)], dtype=np.uint64)
        return eight[self.begin[self.first]] & masks[length]

    def words(self, line: int) -> list[bytes]:
        """Return the words of a line."""
        words = slice(self.first[line], self.first[line] + self.size[line])
        return self._slices(self.begin[words], self.end[words])

    def word(self, number: int) -> bytes:
        """Return a word."""
        return self.data[self.begin[number] : self.end[number]]

    def line_number(self, line: int) -> int:
        """Return the number of a line for messages, counted from 1."""
        return self._line_number(self.begin[self.first[line]])

    def _line_number(self, place: int) -> int:
        """Return the number of the line with a byte."""
        return self._above + self.data.count(self.newline, 0, place) + 1

    def line_ends(self, lines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the bytes where some lines begin, and the bytes where their next lines begin."""
        after = np.searchsorted(self._breaks, self.begin[self.first[lines]])
        return self._breaks[after - 1] + 1, self._breaks[after] + 1

    def vectors(self, lines: np.ndarray, first: int, name: str) -> Numbers:
        """Read three numbers (k, 3) of each of k lines, from word `first` on.

        Raises
        ------
        ValueError
            When a line has too few words, or a word is no number.
        """
        short = lines[self.size[lines] < first + 3]
        if len(short):
            raise ValueError(f"line {self.line_number(short[0])}: {name} needs three coordinates")
        return self.numbers(self.first[lines, None] + first + np.arange(3))

    def numbers(self, words: np.ndarray | slice, *, lenient: bool = False) -> Numbers:
        """Read some words, in ascending order, as float64.

        A word that is no number is NaN if `lenient`; otherwise it raises a ValueError.
        """
        begin, end = self.begin[words], self.end[words]
        value = self._parsed(begin, end, np.float64)
        if value is None:  # Python also reads 1_000
            parts = zip(begin.ravel().tolist(), self._slices(begin, end), strict=True)
            value = np.array([self._number(*part, lenient) for part in parts]).reshape(begin.shape)
        return Numbers(begin, end, value)

    def _number(self, place: int, word: bytes, lenient: bool) -> float:
        """Read a word that begins at a byte; see :meth:`numbers`."""
        if _NAN.fullmatch(word):
            return np.nan
        try:
            return float(word)
        except ValueError:
            if lenient:
                return np.nan
            shown = word.decode("latin-1")[:60]
            raise ValueError(f"line {self._line_number(place)}: {shown!r} is no number") from None

    def integers(self, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Read parts of the text, in ascending order, as int64.

        Raises
        ------
        ValueError
            When a part is not a whole number of at most 18 digits.
        """
        # NumPy reads "-" as 0, and clips large numbers.
        digits = (self._bytes[end - 1] - np.uint8(ord("0")) < 10).all() and (end - begin).max(initial=0) <= 18
        value = self._parsed(begin, end, np.int64) if digits else None
        if value is None:
            words = self._slices(begin, end)
            for word in words:
                if not _INTEGER.fullmatch(word):
                    raise ValueError(f"{word.decode('latin-1')[:60]!r} is no whole number")
            value = np.array([int(word) for word in words]).reshape(begin.shape)
        return value

    def _slices(self, begin: np.ndarray, end: np.ndarray) -> list[bytes]:
        return [self.data[a:b] for a, b in zip(begin.ravel().tolist(), end.ravel().tolist(), strict=True)]

    def _parsed(self, begin: np.ndarray, end: np.ndarray, kind: type) -> np.ndarray | None:
        """Read parts of the text with NumPy; return None unless NumPy reads one number from each part."""
        if not begin.size or (begin == end).any():
            return None
        low, high = begin.flat[0], end.flat[-1]
        step = np.zeros(high - low + 1, dtype=np.int8)
        step[begin - low], step[end - low] = 1, -1
        inside = np.cumsum(step[:-1], dtype=np.int8).view(bool)
        text = np.where(inside, self._bytes[low:high], np.uint8(_BLANK)).tobytes()
        try:
            with warnings.catch_warnings():
                # NumPy before 2.3 warns of a wrong word, and returns the numbers before it.
                warnings.simplefilter("error", DeprecationWarning)
                value: np.ndarray = np.fromstring(text, dtype=kind, sep=" ")
        except (ValueError, DeprecationWarning):
            return None
        # NumPy reads "1-2" as two numbers, and "nan(3)" as one.
        return value.reshape(begin.shape) if value.size == begin.size and b"(" not in text else None


def key_of(word: bytes) -> int:
    """Return the first eight bytes of a word as a number, the first byte lowest."""
    return int.from_bytes(word[:8], "little")


def edited(data: bytes, edits: list[Edits]) -> bytes:
    """Return a text with edits. Of edits at the same byte, the first is written first."""
    if not edits:
        return data
    begin, end = (np.concatenate([edit[i] for edit in edits]) for i in range(2))
    replacements = [text for edit in edits for text in edit.replacements]
    if (begin[1:] < begin[:-1]).any():
        order = np.argsort(begin, kind="stable")
        begin, end, replacements = begin[order], end[order], [replacements[i] for i in order.tolist()]
    text = data.decode("latin-1")
    pieces = [""] * (2 * len(replacements) + 1)
    pieces[1::2] = replacements
    pieces[::2] = [text[a:b] for a, b in zip([0, *end.tolist()], [*begin.tolist(), len(text)], strict=True)]
    return "".join(pieces).encode("latin-1")


def without_comments(data: bytes) -> bytes:
    """Return a text in which blanks replace the comments, from ``#`` to the end of the line.

    The number ``1.#IND`` is no comment.
    """
    return (
        re.sub(rb"#(?<!\.#)[^\r\n]*", lambda comment: b" " * len(comment[0]), data) if b"#" in data else data
    )


def rows_of(prefix: str, values: np.ndarray) -> bytes:
    """Write a line for each row of numbers (k, d): the prefix, then the numbers, separated by blanks."""
    line = f"{prefix}{' '.join(['%r'] * values.shape[1])}\n"
    return (line * len(values) % tuple(values.ravel().tolist())).encode()

"""Read the header of a PLY file and the rows of numbers of its elements."""

from __future__ import annotations

from dataclasses import dataclass, field
from struct import calcsize, unpack_from
from typing import NamedTuple

import numpy as np

from sshade.core.errors import counted
from sshade.core.threads import CHUNK, ThreadTeam, available_cpus
from sshade.files.numbers_in_text import BOM, Text

_OLD_NAMES = ["char", "uchar", "short", "ushort", "int", "uint", "float", "double"]
_NEW_NAMES = ["int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"]
_TYPES = dict(zip(_OLD_NAMES + _NEW_NAMES, map(np.dtype, 2 * _NEW_NAMES), strict=True))
_ORDER = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


class Property(NamedTuple):
    """A number in each row of an element, or a list of numbers; `length` is the type of the list's length."""

    name: str
    kind: np.dtype
    length: np.dtype | None = None


class Rows(NamedTuple):
    """Rows of an element whose lists have the same lengths.

    Attributes
    ----------
    which : (r,) int64 or slice
        Numbers of the rows in the element. A slice stands for all rows.
    begin : (r,) int64 or int
        Byte where each row begins. For all rows, which follow each other, the byte where the first begins.
    values : (r,) structured
        Fields p0, p1, ... hold the properties.
    """

    which: np.ndarray | slice
    begin: np.ndarray | int
    values: np.ndarray

    def places(self, number: int) -> np.ndarray:
        """Return the bytes (r,) where the values of a property begin."""
        begin = np.asarray(self.begin)
        if isinstance(self.which, slice):
            begin = begin + np.arange(len(self.values)) * self.values.dtype.itemsize
        return begin + self.values.dtype.fields[f"p{number}"][1]  # type: ignore[index]


@dataclass
class Element:
    """Rows of properties."""

    name: str
    size: int
    properties: list[Property] = field(default_factory=list)
    rows: list[Rows] = field(default_factory=list)

    def numbers(self, names: str) -> list[int]:
        """Return the numbers of the named properties; empty unless all exist and none is a list."""
        place = {p.name: i for i, p in enumerate(self.properties) if p.length is None}
        return [place[name] for name in names.split()] if place.keys() >= set(names.split()) else []

    def columns(self, properties: list[int]) -> np.ndarray:
        """Return the values (rows, k) float64 of k properties without lists."""
        values = np.empty((self.size, len(properties)))
        for rows in self.rows:
            for column, i in enumerate(properties):
                if isinstance(rows.which, slice):
                    copy_rows(values[:, column], rows.values[f"p{i}"])
                else:
                    values[rows.which, column] = rows.values[f"p{i}"]
        return values


def copy_rows(out: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Copy rows (r, ...) into another array, in its type; all CPUs share large copies. Return that array."""
    cpus, n = available_cpus(), len(rows)
    with ThreadTeam(cpus if n > CHUNK else 1) as team:
        part = max(CHUNK, -(-n // cpus))
        team.ranges(lambda a, b: np.copyto(out[a:b], rows[a:b], casting="unsafe"), n, rows=part)
    return out


def read_header(data: bytes) -> tuple[str, list[Element], int]:
    """Return the byte order ("" for text), the elements, and the place where their numbers begin."""
    if data.removeprefix(BOM)[:3] != b"ply":
        raise ValueError("it does not begin with ply")
    newline = b"\n" if b"\nend_header" in data else b"\r"
    end = data.find(newline + b"end_header")
    begin = data.find(newline, end + 1) + 1
    if end < 0 or not begin:
        raise ValueError("its header has no end")
    order, elements = None, []
    for number, line in enumerate(data[:end].split(newline)[1:], 2):
        words = line.decode("latin-1").split()
        if words[:1] == ["format"] and len(words) == 3 and words[1] in _ORDER:
            order = _ORDER[words[1]]
        elif words[:1] == ["element"] and len(words) == 3 and words[2].isdecimal():
            elements.append(Element(words[1], int(words[2])))
        elif words[:1] == ["property"] and elements and (one := _property(words[1:])):
            elements[-1].properties.append(one)
        elif words and words[0] not in ("comment", "obj_info"):
            raise ValueError(f"line {number} of its header is not understood: {' '.join(words)[:60]!r}")
    if order is None:
        raise ValueError("its header names no format")
    return order, elements, begin


def _property(words: list[str]) -> Property | None:
    if len(words) == 2 and words[0] in _TYPES:
        return Property(words[1], _TYPES[words[0]])
    if len(words) == 4 and words[0] == "list" and {words[1], words[2]} <= _TYPES.keys():
        count = _TYPES[words[1]]
        return Property(words[3], _TYPES[words[2]], count) if count.kind != "f" else None
    return None


def take(data: bytes, at: int, element: Element, order: str) -> tuple[list[Rows], int]:
    """Read the rows of an element that begins at byte `at`; return the rows and the byte where they end."""
    if not element.size or not element.properties:
        return [], at
    codes = [(_code(p.length, order) if p.length else "", _code(p.kind, order)) for p in element.properties]
    lengths = _lengths(data, at, element, codes)
    layout = _layout(lengths, codes)
    end = at + element.size * layout.itemsize
    if end <= len(data):  # all rows may have lists as long as those of the first row
        values = np.frombuffer(data, layout, element.size, at)
        if all((values[f"n{i}"] == n).all() for i, n in enumerate(lengths) if n is not None):
            return [Rows(slice(None), at, values)], end
    layouts: dict[tuple[int | None, ...], np.dtype] = {}
    places: dict[tuple[int | None, ...], list[tuple[int, int]]] = {}
    for row in range(element.size):
        lengths = _lengths(data, at, element, codes)
        if lengths not in layouts:
            layouts[lengths], places[lengths] = _layout(lengths, codes), []
        places[lengths].append((row, at))
        at += layouts[lengths].itemsize
    groups, every = [], np.frombuffer(data, np.uint8)
    for lengths, layout in layouts.items():
        which, begin = np.array(places[lengths]).T
        taken = every[begin[:, None] + np.arange(layout.itemsize)]
        groups.append(Rows(which, begin, taken.view(layout)[:, 0]))
    return groups, at


def declared_words(text: Text, elements: list[Element]) -> tuple[np.ndarray, tuple[str, ...]]:
    """Select the words that the header declares, of a text with one row on each line.

    Parameters
    ----------
    text : Text
        The rows of the elements.
    elements : list of Element

    Returns
    -------
    words : (w,) int64
        Numbers of the declared words.
    notes : tuple of str
        A note for the user if lines have further words behind them, as older versions of MeshLab write.

    Raises
    ------
    ValueError
        When a line has fewer words than declared.
    """
    declared, begin = np.zeros(len(text.first), dtype=np.int64), 0
    for element in elements:
        lines = slice(begin, begin + element.size * bool(element.properties))
        first, size, width = text.first[lines], text.size[lines], declared[lines]
        for one in element.properties:
            if one.length is not None:
                there = width < size
                width[there] += _list_lengths(text, (first + width)[there], element.name)
            width += 1
        begin = lines.stop
    short = np.flatnonzero(text.size < declared)
    if len(short):
        line, number = short[0], text.line_number(short[0])
        has = counted(text.size[line], "value", "values")
        raise ValueError(f"line {number} has {has}; its header declares {declared[line]}")
    within = np.arange(len(text.begin)) - np.repeat(text.first, text.size)
    words = np.flatnonzero(within < np.repeat(declared, text.size))
    longer = np.flatnonzero(text.size > declared)
    if not len(longer):
        return words, ()
    count, number = len(longer), text.line_number(longer[0])
    return words, (
        f"further values than the header declares stay as they are: {counted(count, 'line', 'lines')}, from "
        f"line {number}",
    )


def _list_lengths(text: Text, words: np.ndarray, name: str) -> np.ndarray:
    """Read the lengths of lists from some words."""
    lengths = text.numbers(words).value
    wrong = lengths[(lengths < 0) | (lengths != np.trunc(lengths)) | ~(lengths < 2**31)]
    if len(wrong):
        raise ValueError(f"a list of its element {name} has a length of {wrong[0]}")
    return lengths.astype(np.int64)


def _code(kind: np.dtype, order: str) -> str:
    """Return the code of a type for struct and NumPy. The numbers of a text are read as doubles."""
    return order + kind.char if order else "<d"


def _lengths(data: bytes, at: int, element: Element, codes: list[tuple[str, str]]) -> tuple[int | None, ...]:
    """Return the lengths of the lists in the row that begins at byte `at`; None for plain numbers."""
    lengths: list[int | None] = []
    for length_code, code in codes:
        length = None
        if length_code:
            if at + calcsize(length_code) > len(data):
                break
            (length,) = unpack_from(length_code, data, at)
            if length < 0 or length != int(length):
                raise ValueError(f"a list of its element {element.name} has a length of {length}")
            length = int(length)
            at += calcsize(length_code)
        lengths.append(length)
        at += calcsize(code) * (1 if length is None else length)
    if len(lengths) < len(codes) or at > len(data):
        raise ValueError(f"it ends within the {element.size} rows of its element {element.name}")
    return tuple(lengths)


def _layout(lengths: tuple[int | None, ...], codes: list[tuple[str, str]]) -> np.dtype:
    fields: list[tuple] = []
    for i, (length, (length_code, code)) in enumerate(zip(lengths, codes, strict=True)):
        fields += (
            [(f"p{i}", code)] if length is None else [(f"n{i}", length_code), (f"p{i}", code, (length,))]
        )
    return np.dtype(fields)

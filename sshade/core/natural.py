"""Names in the order of the numbers in them: frame9 before frame10."""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import groupby
from pathlib import Path


def natural(name: str) -> list[tuple[int, str]]:
    """Return a sort key that puts frame9 before frame10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)]


def in_natural_order(paths: Iterable[Path]) -> list[Path]:
    """Sort files whose names differ in numbers alone by these numbers; shells put frame10 before frame9.

    Other files stay where they are.
    """
    ordered: list[Path] = []
    for _, files in groupby(paths, key=lambda path: re.sub(r"\d+", "0", str(path))):
        ordered += sorted(files, key=lambda path: natural(str(path)))
    return ordered

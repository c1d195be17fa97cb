"""Numbered files of a sequence: ``out_%04d.ply`` stands for ``out_0001.ply``, ``out_0002.ply`` and so on."""

from __future__ import annotations

import re
from pathlib import Path

from sshade.core.errors import InputError

_NUMBER = re.compile(r"%(0\d+)?d")


def has_number(path: Path) -> bool:
    """Whether a name has a place for a number, and raise InputError on two places, or one such as ``%4d``."""
    places = re.findall(r"%\d*d", path.name)
    if places and (len(places) > 1 or not _NUMBER.fullmatch(places[0])):
        raise InputError(f"{path}: a pattern has one place for the number, such as out_%04d.ply")
    return bool(places)


def numbered(pattern: Path, number: int) -> Path:
    """Return the path of a pose, counted from 0; files are numbered from 1."""
    return pattern.with_name(_NUMBER.sub(lambda place: place.group() % (number + 1), pattern.name))

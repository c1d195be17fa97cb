"""What the JSON files of a DeFAUST folder must hold, checked before anything in them is used.

A shape is a type, a tuple of alternatives, a list with the shape of its items, a
mapping from keys to shapes (those that end in "?" may be missing, others than the
named ones are left alone), :class:`Each` for a mapping whose keys are free, or
:data:`POINT` for three numbers.
"""

from __future__ import annotations

import math
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any, NamedTuple

from sshade import InputError


class Each(NamedTuple):
    """A mapping of any keys to values of one shape."""

    shape: Any


NULL = type(None)
POINT = object()
COUNTS = {"vertices": int, "faces": int}
FACTS = COUNTS | {
    "euler": int,
    "boundary_loops?": int,
    "volume": (float, NULL),
    "area": float,
    "diagonal": float,
    "self_intersecting_faces": int,
}
SUBJECT = {
    "subject": int,
    "landmark_vertices": Each(int),
    "poses": [{"pose": int, "name": str, "static": int, "dynamic": int, "volume": (float, NULL)}],
    "low": FACTS,
    "high": FACTS | {"ls3_steps": int, "edge_length": (float, NULL), "remeshings": int},
}
FILES = Each({"sha256": str, "bytes": int, "vertices?": int, "faces?": int})
DOCUMENT = {
    "format": int,
    "name": str,
    "source": {
        "name": str,
        **dict.fromkeys(("title", "origin", "licence", "citation", "axes", "unit"), str),
        "limits": [str],
        "note?": str,
        "classes?": [str],
        "files?": Each(str),
    },
    "build": {
        "subjects": [int],
        "seed": int,
        "target_vertices": (int, NULL),
        "window": [float],
        "ls3_steps": (int, NULL),
        "remesh_iterations": int,
        "handles_per_landmark": int,
        "neighbourhood": int,
        "static_below": float,
    },
    "tools": Each(str),
    "landmarks": [str],
    "poses": Each([{"pose": int, "name": str, "aligned": (bool, NULL), "landmarks": [str]}]),
    "subjects": [SUBJECT],
    "files": FILES,
    "checksum": str,
}
#: A subject that is done, as a build under way keeps it.
FINISHED = SUBJECT | {"files": FILES}
#: The handles of a pose.
POSE = {
    "source_pose": str,
    "handles": [
        {
            "landmark": str,
            "kind": str,
            "delta": (float, NULL),
            "delta_mean": (float, NULL),
            "source": [POINT],
            "target": [POINT],
        }
    ],
}
_WORDS = {int: "a whole number", float: "a number", str: "a text", bool: "true or false", NULL: "null"}


def require(value: Any, shape: Any, *, where: str) -> None:
    """Check a JSON value against a shape.

    Raises
    ------
    InputError
        With the place of the first thing that does not fit.
    """
    problem = _problem(value, shape, "")
    if problem:
        raise InputError(f"{where}: damaged, {problem}; restore the file or build the dataset again")


def require_inside(names: Any, *, where: str) -> None:
    """Raise InputError where a listed file is not below the folder that lists it."""
    for name in names:
        parts = PurePosixPath(name).parts
        if not parts or ".." in parts or PurePosixPath(name).is_absolute() or PureWindowsPath(name).anchor:
            raise InputError(f"{where}: it lists the file {name!r}, which is not inside the folder")


def _problem(value: Any, shape: Any, place: str) -> str:
    """What is wrong, or nothing."""
    if isinstance(shape, tuple) and not isinstance(shape, Each):
        problems = [_problem(value, one, place) for one in shape]
        return "" if "" in problems else problems[0]
    if isinstance(shape, list):
        if not isinstance(value, list):
            return f"{place or 'it'} is no list"
        found = (_problem(item, shape[0], f"{place}[{i}]") for i, item in enumerate(value))
        return next(filter(None, found), "")
    if isinstance(shape, (dict, Each)):
        if not isinstance(value, dict):
            return f"{place or 'it'} is no object"
        if isinstance(shape, Each):
            shape = dict.fromkeys(value, shape.shape)
        for key, one in shape.items():
            name = key.removesuffix("?") if key not in value else key
            at = f"{place}.{name}" if place else name
            if name in value:
                problem = _problem(value[name], one, at)
                if problem:
                    return problem
            elif not key.endswith("?"):
                return f"it has no {at}"
        return ""
    if shape is POINT:
        fits = isinstance(value, list) and len(value) == 3 and all(_is(x, float) for x in value)
        return "" if fits else f"{place} is not three numbers"
    return "" if _is(value, shape) else f"{place} is not {_WORDS[shape]}"


def _is(value: Any, kind: type) -> bool:
    if kind is float:
        return type(value) in (int, float) and math.isfinite(value)
    return type(value) is kind

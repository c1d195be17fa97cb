"""Check the lists and mappings that a configuration gives to a source."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from defaust.schema import mismatch
from defaust.sources.source import Source, SourcePose
from sshade import InputError

#: Maximum number of names in an error message; further names are counted.
LISTED = 6


def require_choice(
    value: Any, *, known: Collection[Any], option: str, empty: bool = False
) -> tuple[Any, ...]:
    """Return the items of a list after checking them.

    Raises
    ------
    InputError
        When the value is not a list, or has an unknown or repeated item, or is empty unless `empty`.
    """
    kind = int if isinstance(next(iter(known), ""), int) else str
    items = list(value) if isinstance(value, tuple) else value
    problem = mismatch(items, [kind], option)
    if problem:
        raise InputError(problem)
    if not items and not empty:
        raise InputError(f"{option} is empty; it needs at least one entry")
    for item in items:
        if item not in known:
            raise InputError(f"{option}: there is no {item!r}; choose from {shortened(list(known))}")
        if items.count(item) > 1:
            raise InputError(f"{option}: {item!r} is listed twice")
    return tuple(items)


def check_choice(source: Any, attribute: str, *, known: Collection[Any], empty: bool = False) -> None:
    """Check a parameter of a source by :func:`require_choice`, and store it as a tuple."""
    value = getattr(source, attribute)
    items = require_choice(value, known=known, option=f"source.{attribute}", empty=empty)
    object.__setattr__(source, attribute, items)


def require_landmarks(value: Any) -> dict[str, int]:
    """Check a mapping of names to distinct vertex ids; raise InputError on anything else."""
    option = "source.landmarks"
    problem = mismatch(dict(value) if isinstance(value, Mapping) else value, {str: int}, option)
    if problem or not value:
        raise InputError(f"{problem or f'{option} is empty'}; give names and vertices, e.g. {{nose: 332}}")
    vertices = list(value.values())
    for name, vertex in value.items():
        if vertex < 0:
            raise InputError(f"{option}: the vertex of {name} is {vertex}; give a number from 0 up")
        if vertices.count(vertex) > 1:
            raise InputError(f"{option}: {name} shares vertex {vertex} with another landmark")
    return {str(name): vertex for name, vertex in value.items()}


def shortened(names: Sequence[Any]) -> str:
    """Join names by commas; names beyond :data:`LISTED` are only counted."""
    more = len(names) - LISTED
    return ", ".join(map(str, names[:LISTED])) + (f" and {more} more" if more > 0 else "")


class OneTemplate(Source):
    """A source whose subjects share one vertex numbering and the same poses.

    Attributes
    ----------
    base_landmarks : tuple of str
        Landmarks with handles in every pose.
    more_landmarks : tuple of str
        Additional landmarks in poses that are turned as a whole against the rest pose. They keep the
        motion of the whole body from being determined by a few points.
    """

    base_landmarks: tuple[str, ...]
    more_landmarks: tuple[str, ...]

    @property
    def landmark_names(self) -> tuple[str, ...]:
        """Base landmarks, then the additional ones."""
        return (*self.base_landmarks, *self.more_landmarks)

    def _poses(self, names: Iterable[tuple[str, bool]]) -> tuple[SourcePose, ...]:
        """Poses of the given names; each name comes with whether the pose is aligned."""
        return tuple(
            SourcePose(name, self.base_landmarks if aligned else self.landmark_names, aligned)
            for name, aligned in names
        )

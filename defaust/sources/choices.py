"""What a configuration chooses of a source, checked."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from defaust.schema import mismatch
from defaust.sources.source import SourcePose
from sshade import InputError

#: Names listed in a sentence before it says "and so many more".
LISTED = 6


def require_choice(
    value: Any, *, known: Collection[Any], option: str, empty: bool = False
) -> tuple[Any, ...]:
    """The items of a list that chooses some of the known ones.

    Raises
    ------
    InputError
        When it is no list, names another item, or one twice; or is empty, unless allowed.
    """
    kind = int if isinstance(next(iter(known), ""), int) else str
    items = list(value) if isinstance(value, tuple) else value
    problem = mismatch(items, [kind], option)
    if problem:
        raise InputError(problem)
    if not items and not empty:
        raise InputError(f"{option} is empty; it needs one entry at least")
    for item in items:
        if item not in known:
            raise InputError(f"{option}: there is no {item!r}; choose from {shortened(list(known))}")
        if items.count(item) > 1:
            raise InputError(f"{option}: {item!r} is listed twice")
    return tuple(items)


def check_choice(source: Any, attribute: str, *, known: Collection[Any], empty: bool = False) -> None:
    """Check a parameter of a source by :func:`require_choice`, and keep it as a tuple."""
    value = getattr(source, attribute)
    chosen = require_choice(value, known=known, option=f"source.{attribute}", empty=empty)
    object.__setattr__(source, attribute, chosen)


def require_landmarks(value: Any, *, option: str) -> dict[str, int]:
    """A mapping of names to vertex ids, of which no two are the same; InputError on anything else."""
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
    """The names, or the first of them and how many follow."""
    more = len(names) - LISTED
    return ", ".join(map(str, names[:LISTED])) + (f" and {more} more" if more > 0 else "")


class OneTemplate:
    """Part of a source whose subjects have one numbering of vertices, and all the same poses.

    Attributes
    ----------
    landmarks : mapping
        Vertex of each landmark that can be chosen.
    base_landmarks, more_landmarks : tuple of str
        Landmarks with handles in every pose, and those added where a pose is not aligned with the rest
        pose, so that few points do not have to fix its motion as a whole.
    """

    name: str
    subjects: tuple[int, ...]
    landmarks: Mapping[str, int]
    base_landmarks: tuple[str, ...]
    more_landmarks: tuple[str, ...]

    @property
    def landmark_names(self) -> tuple[str, ...]:
        """Base landmarks, then the others."""
        return (*self.base_landmarks, *self.more_landmarks)

    def landmark_vertices(self, subject: int) -> dict[str, int]:
        """The same vertices on every subject."""
        self._require(subject)
        return {name: self.landmarks[name] for name in self.landmark_names}

    def _check_landmarks(self) -> None:
        """Raise InputError unless the landmarks are known ones, each listed once."""
        for attribute, empty in (("base_landmarks", False), ("more_landmarks", True)):
            check_choice(self, attribute, known=self.landmarks, empty=empty)
        both = "source.base_landmarks and source.more_landmarks"
        require_choice(self.landmark_names, known=self.landmarks, option=both)

    def _poses(self, subject: int, names: Iterable[tuple[str, bool]]) -> tuple[SourcePose, ...]:
        """Poses of these names, aligned or not."""
        self._require(subject)
        return tuple(
            SourcePose(name, self.base_landmarks if aligned else self.landmark_names, aligned)
            for name, aligned in names
        )

    def _require(self, subject: int) -> None:
        if subject not in self.subjects:
            raise InputError(f"there is no {self.name} subject {subject}; they are 0 to {self.subjects[-1]}")

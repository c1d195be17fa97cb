"""The tracks of the leaderboard, of ``conf/tracks.yaml``, and the rows published for them."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import pandas as pd
import yaml

from eval.rows.frame import read_csv
from eval.rows.store import PUBLISHED
from sshade.cli.configuration import CONFIGURATION
from sshade.errors import InputError

#: Rows are no part of a wheel.
WHERE = "run this in a clone of the repository"


class Track(NamedTuple):
    """A published experiment as a contest.

    Attributes
    ----------
    name : str
        Of the experiment.
    title, text : str
    timing : str, optional
        Name of the rows of times that are about its size.
    """

    name: str
    title: str
    text: str
    timing: str | None


def read_tracks(path: Path = CONFIGURATION / "tracks.yaml") -> dict[str, Track]:
    """The tracks by name, in their order."""
    with path.open(encoding="utf-8") as file:
        return {name: Track(name, **facts) for name, facts in yaml.safe_load(file).items()}


def published(track: Track, results: Path = PUBLISHED) -> pd.DataFrame:
    """The project's rows of a track.

    Raises
    ------
    InputError
        When none were published.
    """
    path = _rows(track, results)
    if not path.is_file():
        raise InputError(f"the track {track.name} has no published rows, {path}: {WHERE}")
    return read_csv(path)


def is_published(track: Track, results: Path = PUBLISHED) -> bool:
    """Whether the project has rows of a track yet."""
    return _rows(track, results).is_file()


def _rows(track: Track, results: Path) -> Path:
    return results / "rows" / f"{track.name}.csv"

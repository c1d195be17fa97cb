"""The tracks of the leaderboard, from ``conf/tracks.yaml``, and their published rows."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import pandas as pd
import yaml

from eval.rows.files import PUBLISHED
from eval.rows.frame import read_csv
from sshade.cli.configuration import CONFIGURATION
from sshade.errors import InputError

#: End of the message about missing rows: a wheel does not contain them.
WHERE = "run this in a clone of the repository"


class Track(NamedTuple):
    """A published experiment as a track.

    Attributes
    ----------
    name : str
        Name of the experiment.
    title, text : str
    timing : str, optional
        Name of the rows of times on cases of a similar size.
    """

    name: str
    title: str
    text: str
    timing: str | None


def read_tracks(path: Path = CONFIGURATION / "tracks.yaml") -> dict[str, Track]:
    """Return the tracks by name, in their order."""
    with path.open(encoding="utf-8") as file:
        return {name: Track(name, **facts) for name, facts in yaml.safe_load(file).items()}


def published(track: Track, results: Path = PUBLISHED) -> pd.DataFrame:
    """Return the project's rows of a track.

    Raises
    ------
    InputError
        If the track has no published rows.
    """
    path = _rows(track, results)
    if not path.is_file():
        raise InputError(f"the track {track.name} has no published rows, {path}: {WHERE}")
    return read_csv(path)


def is_published(track: Track, results: Path = PUBLISHED) -> bool:
    """Whether the track has published rows."""
    return _rows(track, results).is_file()


def _rows(track: Track, results: Path) -> Path:
    return results / "rows" / f"{track.name}.csv"

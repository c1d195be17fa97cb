"""The tracks of the leaderboard, from ``conf/tracks.yaml``, and their published rows."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import pandas as pd

from eval.rows.files import PUBLISHED, read_conf
from eval.rows.frame import read_csv
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

    @property
    def path(self) -> Path:
        """The published rows."""
        return PUBLISHED / "rows" / f"{self.name}.csv"


def read_tracks() -> dict[str, Track]:
    """Return the tracks by name, in their order."""
    return {name: Track(name, **facts) for name, facts in read_conf("tracks").items()}


def published(track: Track) -> pd.DataFrame:
    """Return the project's rows of a track.

    Raises
    ------
    InputError
        If the track has no published rows.
    """
    if not track.path.is_file():
        raise InputError(f"the track {track.name} has no published rows, {track.path}: {WHERE}")
    return read_csv(track.path)

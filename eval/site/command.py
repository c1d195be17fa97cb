"""The leaderboard as static pages: ``sshade-eval site`` from published rows and submissions.

One page lists all tracks (conf/tracks.yaml). Each track has a page with tables, quality against time and rows
to download. Each method has a page with its configuration, cases, failures and provenance.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from eval.rows.files import PUBLISHED, add_out
from eval.rows.frame import records
from eval.site.pages import contests_of, write_site
from eval.site.submission import Submission, check, read_facts
from eval.site.submit import SUBMISSIONS
from eval.site.tracks import WHERE, published, read_tracks
from sshade.errors import InputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_out(parser, Path("out/leaderboard"), "folder to write")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    import jinja2  # noqa: F401 - refused before the rows are read
    import matplotlib  # noqa: F401

    known = read_tracks()
    tracks = {name: track for name, track in known.items() if track.path.is_file()}
    if not tracks:
        raise InputError(f"no track has published rows in {PUBLISHED / 'rows'}: {WHERE}")
    for name in known.keys() - tracks.keys():
        print(f"left out: {name}, which has no published rows")  # noqa: T201
    rows = {track.name: published(track) for track in tracks.values()}
    submissions: dict[str, Submission] = {}
    for folder in sorted(path.parent for path in SUBMISSIONS.glob("*/submission.yaml")):
        name = read_facts(folder)["track"]
        if name not in tracks:
            raise InputError(f"{folder}: {name!r} is no track; the tracks are {', '.join(tracks)}")
        found = check(folder, tracks[name], records(rows[name]))
        if submissions.setdefault(found.facts["name"], found) is not found:
            raise InputError(f"{folder}: another submission is called {found.facts['name']}")
    contests = [own for track in tracks.values() for own in contests_of(track, rows[track.name], submissions)]
    written = write_site(options.out, contests, submissions)
    print(f"{options.out}: {len(written)} pages; open {written[0]} in a browser")  # noqa: T201
    return 0

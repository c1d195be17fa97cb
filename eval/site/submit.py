"""Hand in results for the leaderboard: ``sshade-eval submit FOLDER``.

The folder holds submission.yaml (name, track, authors, code), method.yaml, rows.csv and optionally the run
folders with the vertices, which are measured again. Rows must come from one configuration, one version and a
clean commit, and cover every held-out case of the track once for each seed. Unless --check is given, the
files without vertices are copied to submissions/NAME for a pull request. See CONTRIBUTING.md.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from eval.rows.files import copy_file
from eval.site.submission import check, read_facts
from eval.site.tracks import published, read_tracks
from sshade.cli.console import progress_bar
from sshade.errors import InputError

#: Folder of committed submissions.
SUBMISSIONS = Path("submissions")
FILES = ("submission.yaml", "method.yaml", "rows.csv")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="the submission")
    parser.add_argument("--check", action="store_true", help="check the submission, and write nothing")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    tracks, facts = read_tracks(), read_facts(options.folder)
    if facts["track"] not in tracks:
        raise InputError(f"{facts['track']!r} is no track; the tracks are {', '.join(tracks)}")
    track = tracks[facts["track"]]
    rows = published(track).to_dict("records")
    with progress_bar() as progress:
        found = check(options.folder, track, rows, progress=progress)
    seeds = len({row["seed"] for row in found.rows})
    measured = "none with vertices: measures are as reported"
    if found.remeasured:
        measured = f"{found.remeasured} measured again from their vertices"
    runs = f"{len(found.rows)} runs, {seeds} seed{'s' * (seeds > 1)}"
    print(f"{facts['name']} on {track.name}: {runs}, {measured}")  # noqa: T201
    if not options.check:
        target = SUBMISSIONS / facts["name"]
        for name in FILES:
            copy_file(options.folder / name, target / name)
        print(f"copied to {target}; commit it, and open a pull request")  # noqa: T201
    return 0

"""The leaderboard as static pages: ``sshade-eval site`` from published rows and submissions.

One page lists all tracks (conf/tracks.yaml). Each track has a page with tables, quality against time and rows
to download. Each method has a page with its configuration, cases, failures and provenance.
"""

from __future__ import annotations

import argparse
import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from eval.publish.columns import SUCCESS, begun
from eval.publish.front import TIME, draw, with_times
from eval.publish.html import charts, configuration, facts, render, texts
from eval.publish.summary import Table, make_table
from eval.rows.files import PUBLISHED, add_out, write_text
from eval.rows.frame import distinct, method_names, read_csv, records, to_frame, valid, write_csv
from eval.rows.splits import HELD_OUT, split_of
from eval.rows.store import MISSING, Row, version_of
from eval.site.ranking import rankings
from eval.site.submission import SUBMISSIONS, Submission, check, read_facts
from eval.site.tracks import WHERE, Track, published, read_tracks
from eval.timing.table import cells, make_time_table
from sshade.errors import InputError

#: Headings of the measures that are drawn against time.
DRAWN = ("EL", "truth", "FA", "normal")
#: Largest rank that the page of all tracks shows.
SHOWN = 5


class Contest(NamedTuple):
    """A track, its held-out rows with the rows of submissions, and their table."""

    track: Track
    rows: pd.DataFrame
    table: Table


def contests_of(track: Track, rows: pd.DataFrame, submissions: Mapping[str, Submission]) -> list[Contest]:
    """Return the contest of a track; submissions measured by other versions of the metrics have their own.

    Parameters
    ----------
    track : Track
    rows : DataFrame
        The project's rows of the track.
    submissions : mapping
        Name of the method -> submission, of all tracks.

    Raises
    ------
    InputError
        If the rows of a method are of several versions of the code, the project's rows are of several
        versions of the metrics, or methods have different tasks of the same name.
    """
    ours = records(rows)
    known = {version_of(row)[1] for row in ours if row["status"] != MISSING}
    entered: dict[str | None, list[Row]] = {}
    for own in submissions.values():
        if own.facts["track"] == track.name:
            version = version_of(own.rows[0])[1]
            entered.setdefault(None if version in known else version, []).extend(own.rows)
    found = [_contest(track, [*ours, *entered.pop(None, [])])]
    for version, others in entered.items():
        short = str(version)[:8]
        text = f"{track.text} Measured by version {short} of the metrics, which the track does not use yet."
        name, title = f"{track.name}_{short}", f"{track.title}, metrics {short}"
        found.append(_contest(track._replace(name=name, title=title, text=text, timing=None), others))
    return found


def _contest(track: Track, rows: list[Row]) -> Contest:
    """Return the contest of the held-out rows; they must be of the same tasks."""
    every = to_frame(rows)
    every = every[every["task.name"].map(split_of) == HELD_OUT].reset_index(drop=True)
    tasks = begun(every).groupby("task.name")["task.checksum"].nunique()
    if (tasks > 1).any():
        raise InputError(
            f"{track.name}: its rows are of {tasks.max()} tasks that are called {tasks.idxmax()}, of several "
            "tracks or builds of the dataset: rank each of them apart"
        )
    return Contest(track, every, make_table(every, title=track.title))


def write_site(
    out: Path,
    contests: list[Contest],
    submissions: Mapping[str, Submission],
    *,
    results: Path = PUBLISHED,
) -> list[Path]:
    """Write all pages into a folder; return their paths.

    Parameters
    ----------
    out : path
    contests : list of Contest
    submissions : mapping
        Name of the method -> submission.
    results : path
        Folder of published times and pictures.
    """
    every = to_frame([row for own in contests for row in records(own.rows)])
    methods = method_names(every)
    shared = {"tracks": [own.track for own in contests], "methods": methods}
    pages, ranked = {"index": ""}, []
    for own in contests:
        name = own.track.name
        seconds, machine, told = _seconds(own, results)
        ranked.append(_ranked(own, seconds, told))
        write_csv(out / f"{name}.csv", own.rows)
        page = {"track": own.track, "table": own.table, "facts": facts(valid(own.rows))}
        page |= {"ranked": ranked[-1], "charts": charts(_charts(own, seconds, machine))}
        picture = results / "figures" / f"{name}.png"
        page["picture"] = base64.b64encode(picture.read_bytes()).decode() if picture.is_file() else None
        pages[name] = render("site/track.html", **page, **shared)
    for method in methods:
        of_tracks = [_cases(own, method) for own in contests if method in set(own.rows["method.name"])]
        rows = every[every["method.name"] == method]
        page = {"method": method, "of_tracks": of_tracks, "facts": facts(rows)}
        page |= {"settings": _settings(contests, method), "submission": submissions.get(method)}
        page["times"] = _times(contests, method, results)
        page["notes"] = distinct(rows, "method.note")
        pages[f"method_{method}"] = render("site/method.html", **page, **shared)
    pages["index"] = render("site/index.html", contests=ranked, shown=SHOWN, **shared)
    for name, text in pages.items():
        write_text(out / f"{name}.html", text)
    return [out / f"{name}.html" for name in pages]


def _ranked(own: Contest, seconds: dict[str, float], told: str) -> dict[str, Any]:
    """Return the rankings of a track, and the sentences above them."""
    counts = {"cases": own.rows["task.name"].nunique(), "methods": own.rows["method.name"].nunique()}
    found = rankings(own.table, seconds)
    return {"track": own.track, "rankings": found, "by": next(iter(found)), "told": told, **counts}


def _settings(contests: list[Contest], method: str) -> str:
    """Return each configuration of a method below the titles of its tracks."""
    titles: dict[str, list[str]] = {}
    for own in contests:
        rows = begun(own.rows)
        if method in set(rows["method.name"]):
            titles.setdefault(configuration(rows, method), []).append(own.track.title)
    return "\n".join(f"# {'; '.join(found)}\n{text}" for text, found in titles.items())


def _cases(own: Contest, method: str) -> dict[str, Any]:
    """Return the runs of a method on a track: numbers, or the reason why there are none."""
    columns = [column for column in own.table.columns if column.source != SUCCESS]
    body = [
        [row["task.name"], row["seed"], row["status"], *texts(row, columns, missing=""), row["reason"] or ""]
        for row in records(own.rows[own.rows["method.name"] == method])
    ]
    labels = ["case", "seed", "status", *(column.label for column in columns), "reason"]
    return {"track": own.track, "labels": labels, "body": body}


def _times(contests: list[Contest], method: str, results: Path) -> list[dict[str, Any]]:
    """Return the times of a method, a table for each file of times that a track names."""
    found = []
    for name in dict.fromkeys(own.track.timing for own in contests if own.track.timing):
        table = make_time_table(read_csv(results / "timing" / f"{name}.csv"), title=name)
        lines = table.lines[table.lines["method"] == method].drop(columns="method")
        if len(lines):
            labels, body = cells(lines)
            found.append({"labels": labels, "body": body, "notes": table.notes})
    return found


def _charts(own: Contest, seconds: dict[str, float], machine: str) -> dict[str, Any]:
    """Draw measures against times, of the methods that were timed at a similar size."""
    drawn = {}
    for column in own.table.columns:
        if column.heading in DRAWN:
            means = own.table.means[column.heading].dropna()
            points = {name: [(seconds[name], mean)] for name, mean in means.items() if name in seconds}
            if points:
                measures = (TIME, column.source.removeprefix("metric."))
                drawn[f"{column.heading} against time"] = draw({None: points}, measures, machine=machine)
    return drawn


def _seconds(own: Contest, results: Path) -> tuple[dict[str, float], str, str]:
    """Return the times of the methods of a track, their machine, and a sentence about the times."""
    if own.track.timing is None:
        return {}, "", "No times were measured on cases of this size."
    times = read_csv(results / "timing" / f"{own.track.timing}.csv")
    timed, machine = with_times(own.rows, times)
    seconds = timed.drop_duplicates("method.name").set_index("method.name")[f"metric.{TIME}"]
    case = f"one case of {times['task.vertices'].iloc[0]:,} vertices"
    return seconds.to_dict(), machine, f"The times are of {case}, on a quiet machine: {machine}."


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

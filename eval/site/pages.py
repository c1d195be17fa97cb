"""The pages of the leaderboard: one of all tracks, one a track, one a method, and the rows to download."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from eval.publish.columns import SUCCESS, Column
from eval.publish.html import charts, configuration, environment, facts, style, views
from eval.publish.plotting import look, new_figure, plot_points
from eval.publish.plotting import style as drawing
from eval.publish.summary import Table, make_table
from eval.rows.frame import method_names, read_csv, records, to_frame, valid, write_csv
from eval.rows.splits import HELD_OUT, split_of
from eval.rows.store import PUBLISHED
from eval.site.submission import Submission
from eval.site.tracks import Track
from eval.timing.table import make_time_table
from sshade.io.files import make_folder, replacing

#: Measures of the charts of quality against time.
DRAWN = ("EL", "truth", "FA", "normal")


class Contest(NamedTuple):
    """A track with its held-out rows, those of submissions among them, and their table."""

    track: Track
    rows: pd.DataFrame
    table: Table


def contest(track: Track, rows: pd.DataFrame, submissions: Mapping[str, Submission]) -> Contest:
    """A track's held-out cases by all methods; submissions are of versions of their own."""
    theirs = [row for own in submissions.values() if own.facts["track"] == track.name for row in own.rows]
    every = to_frame([*records(rows), *theirs])
    every = every[every["task.name"].map(split_of) == HELD_OUT].reset_index(drop=True)
    return Contest(track, every, make_table(every, title=track.title, mixed=bool(theirs)))


def write_site(
    out: Path,
    contests: list[Contest],
    submissions: Mapping[str, Submission],
    *,
    results: Path = PUBLISHED,
) -> list[Path]:
    """Write all pages into a folder; those written.

    Parameters
    ----------
    out : path
    contests : list of Contest
    submissions : mapping
        By the name of the method.
    results : path
        Where times and pictures were published.
    """
    make_folder(out)
    every = to_frame([row for own in contests for row in records(own.rows)])
    methods = method_names(every)
    shared = {"tracks": [own.track for own in contests], "style": style(), "methods": methods}
    written = [_write(out / "index.html", "index.html", contests=[_front(own) for own in contests], **shared)]
    for own in contests:
        name = own.track.name
        write_csv(out / f"{name}.csv", own.rows)
        page = {"track": own.track, **_tables(own.table), "facts": facts(valid(own.rows))}
        page["charts"] = charts(_charts(own, results))
        page["picture"] = _picture(results / "figures" / f"{name}.png")
        written.append(_write(out / f"{name}.html", "track.html", **page, **shared))
    for method in methods:
        of_tracks = [_cases(own, method) for own in contests if method in set(own.rows["method.name"])]
        rows = every[every["method.name"] == method]
        page = {"method": method, "of_tracks": of_tracks, "facts": facts(rows)}
        page |= {"settings": configuration(rows, method), "submission": submissions.get(method)}
        page["times"] = _times(contests, method, results)
        page["notes"] = sorted(
            {note for note in rows.reindex(columns=["method.note"])["method.note"] if note}
        )
        written.append(_write(out / f"method_{method}.html", "method.html", **page, **shared))
    return written


def _write(path: Path, template: str, **names: Any) -> Path:
    from jinja2 import PackageLoader

    text = environment(loader=PackageLoader("eval.site", "")).get_template(template).render(**names)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def _picture(path: Path) -> str | None:
    """The published picture of a track as a data URI; None where there is none."""
    if not path.is_file():
        return None
    return f"data:image/png;base64,{base64.b64encode(path.read_bytes()).decode()}"


def _tables(table: Table) -> dict[str, Any]:
    parts = [{"title": part.title, "views": views(part), "notes": part.notes} for part in table.parts]
    return {"views": views(table), "notes": table.notes, "parts": parts}


def _front(own: Contest) -> dict[str, Any]:
    """What the page of all tracks says of one: who is best in each column."""
    means = own.table.means[own.table.lines["competes"].astype(bool)]
    best = [_least(column, means[column.heading]) for column in own.table.columns if column.ranked]
    counts = {"cases": own.rows["task.name"].nunique(), "methods": own.rows["method.name"].nunique()}
    return {"track": own.track, "best": [line for line in best if line], **counts}


def _least(column: Column, means: pd.Series) -> dict[str, Any] | None:
    """The methods that print a column's least number; None where nothing is to be told apart."""
    printed = means.dropna().map(column.text)
    if printed.nunique() < 2:
        return None
    least = printed[means.idxmin()]
    return {"label": column.label, "value": least, "methods": list(printed.index[printed == least])}


def _cases(own: Contest, method: str) -> dict[str, Any]:
    """A method's runs of a track: numbers, or why there are none."""
    columns = [column for column in own.table.columns if column.source != SUCCESS]
    body = []
    for row in records(own.rows[own.rows["method.name"] == method]):
        values = [row.get(column.source) for column in columns]
        texts = ["" if v is None else c.text(v) for c, v in zip(columns, values, strict=True)]
        body.append([row["task.name"], row["seed"], row["status"], *texts, row.get("reason") or ""])
    labels = ["case", "seed", "status", *(column.label for column in columns), "reason"]
    return {"track": own.track, "labels": labels, "body": body}


def _times(contests: list[Contest], method: str, results: Path) -> list[dict[str, Any]]:
    """A method's times, of the rows that name their machine, for each size that tracks are of."""
    tables = []
    for name in dict.fromkeys(own.track.timing for own in contests if own.track.timing):
        table = make_time_table(read_csv(results / "timing" / f"{name}.csv"), title=name)
        own = table.lines[table.lines["method"] == method]
        names = ["vertices", "seconds.total", "seconds.min", "seconds.max", "repeats"]
        body = [
            [case, *map(_number, values)] for case, *values in own[["case", *names]].itertuples(index=False)
        ]
        if body:
            tables.append({"title": name, "body": body, "notes": table.notes[:3]})
    return tables


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 or value == int(value) else f"{value:.3g}"


@drawing()
def _charts(own: Contest, results: Path) -> dict[str, Any]:
    """Measures against times, of methods that were timed at about this size."""
    if own.track.timing is None:
        return {}
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    path = results / "timing" / f"{own.track.timing}.csv"
    lines = make_time_table(read_csv(path), title=own.track.timing).lines
    seconds = lines.drop_duplicates("method").set_index("method")["seconds.total"]
    drawn = {}
    for column in own.table.columns:
        means = own.table.means[column.heading] if column.heading in DRAWN else pd.Series(dtype=float)
        points = {
            method: [(seconds[method], means[method])]
            for method in own.table.lines.index
            if method in seconds and np.isfinite(means.get(method, np.nan))
        }
        if points:
            figure = new_figure(3.6, 2.8)
            axes = figure.add_subplot()
            plot_points(axes, points, look(own.table.lines.index))
            axes.set(xscale="log", xlabel="time (s)", ylabel=column.label)
            axes.set_ylim(0, 1.1 * max(value for ((_, value),) in points.values()) or 1)
            axes.xaxis.set(
                major_locator=LogLocator(subs=(1, 2, 5)),
                major_formatter=StrMethodFormatter("{x:g}"),
                minor_formatter=NullFormatter(),
            )
            axes.legend()
            drawn[f"{column.heading} against time"] = figure
    return drawn

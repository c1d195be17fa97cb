"""Rankings of a track: methods in the order of a column, for each column that readers may choose.

Ranks are those of the tables (:mod:`eval.publish.intervals`): methods that cannot be told apart from the best
share its rank. Times are of one case, so they only order the methods.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import pandas as pd

from eval.publish.columns import Column
from eval.publish.summary import Table
from eval.publish.tables import difference_text

#: Headings of the columns that rank by default: the first that a table has with numbers.
RANKING = ("truth", "EL")
#: Headings of further columns of a ranking.
SHOWN = ("volume", "EL")
#: Label of the times.
TIME = "time (s)"


class Ranking(NamedTuple):
    """Methods in their order.

    Attributes
    ----------
    title : str
        Kind of handles, if the track has several; may be empty.
    by : str
        Label of the column that ranks.
    note : str
        Sentence on the ranks.
    labels : list of str
        Headings.
    lines : list of (int or None, list of str)
        Rank, None for a method without one, and the texts below the headings.
    """

    title: str
    by: str
    note: str
    labels: list[str]
    lines: list[tuple[int | None, list[str]]]

    def first(self, count: int) -> list[list[str]]:
        """Return the texts of the methods up to a rank, or of the first methods if there are no ranks."""
        if all(rank is None for rank, _ in self.lines):
            return [texts for _, texts in self.lines[:count]]
        return [texts for rank, texts in self.lines if rank is not None and rank <= count]


def rankings(table: Table, seconds: Mapping[str, float]) -> dict[str, list[Ranking]]:
    """Return the rankings of a track: label of a column -> a ranking for each kind of handles.

    Parameters
    ----------
    table : Table
    seconds : mapping
        Method -> time on one machine, with the version of the code that made the table.
    """
    kinds = [part for part in table.parts if part.title.startswith("handles: ")]
    found: dict[str, list[Ranking]] = {}
    for own in kinds or [table]:
        title, means = own.title if kinds else "", own.means[own.lines["competes"]]
        main = [column for column in own.columns if column.main and means[column.heading].notna().any()]
        for column in sorted(main, key=_by_default):
            found.setdefault(column.label, []).append(_ranking(title, own, column, seconds))
        if seconds:
            found.setdefault(TIME, []).append(_by_time(title, own, seconds))
    return found


def _by_default(column: Column) -> int:
    return RANKING.index(column.heading) if column.heading in RANKING else len(RANKING)


def _ranking(title: str, table: Table, by: Column, seconds: Mapping[str, float]) -> Ranking:
    """Return the methods in the order of ranks, or of means if there are no ranks."""
    means, places = table.means[by.heading], table.places[by.heading]
    order = pd.DataFrame({"place": places, "mean": means.where(table.lines["competes"].astype(bool))})
    order = order.sort_values(["place", "mean"], kind="stable")
    reference = [f"difference to {table.reference}"] if table.differences else []
    others = [column for column in _shown(table) if column != by]
    lines: list[tuple[int | None, list[str]]] = []
    for method, (place, _) in order.iterrows():
        rank = None if pd.isna(place) else int(place)
        shared = " =" * int((places == place).sum() > 1)
        texts = ["-" if rank is None else f"{rank}{shared}", str(method)]
        texts += [table.lines.loc[method, "outcome"] if pd.isna(means[method]) else by.text(means[method])]
        if reference:
            of_method = table.differences[by.heading].reindex([method]).iloc[0]
            texts.append("-" if method == table.reference else difference_text(by, of_method))
        texts += _numbers(table, method, others)
        lines.append((rank, texts + _time(method, seconds)))
    note = f"A method shares the place (=) of a better one if {table.subjects} subjects cannot decide."
    if places.isna().all():
        note = "No ranks, because there are fewer than three subjects or two methods: sorted by the mean."
    labels = ["rank", "method", by.label, *reference, *(c.label for c in others), *[TIME] * bool(seconds)]
    return Ranking(title, by.label, note, labels, lines)


def _by_time(title: str, table: Table, seconds: Mapping[str, float]) -> Ranking:
    """Return the timed methods in the order of their times, without ranks."""
    others = _shown(table)
    methods = sorted((name for name in table.lines.index if name in seconds), key=seconds.__getitem__)
    lines = [(None, ["-", name, *_time(name, seconds), *_numbers(table, name, others)]) for name in methods]
    note = "No ranks, because the times are of one case: sorted by time."
    labels = ["rank", "method", TIME, *(column.label for column in others)]
    return Ranking(title, TIME, note, labels, lines)


def _shown(table: Table) -> list[Column]:
    """Return the columns that every ranking shows."""
    found = table.means.dropna(axis="columns", how="all")
    return [c for c in table.columns if c.heading in (RANKING[0], *SHOWN) and c.heading in found]


def _numbers(table: Table, method: str, columns: list[Column]) -> list[str]:
    means = table.means.loc[method]
    return ["-" if pd.isna(means[c.heading]) else c.text(means[c.heading]) for c in columns]


def _time(method: str, seconds: Mapping[str, float]) -> list[str]:
    """Return the time of a method; nothing if no method has a time."""
    return [f"{seconds[method]:.3g}" if method in seconds else "-"] * bool(seconds)

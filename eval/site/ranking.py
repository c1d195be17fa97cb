"""Rankings of a track: methods in the order of one column, with the volume, the stretch and the time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from eval.publish.columns import Column
from eval.publish.summary import Table

#: Headings of the columns that rank: the first that a table has with numbers.
RANKING = ("truth", "EL")
#: Headings of further columns of a ranking.
SHOWN = ("volume", "EL")


class Ranking(NamedTuple):
    """Methods in their order.

    Attributes
    ----------
    title : str
        Kind of handles, if the track has several; may be empty.
    columns : list of Column
        The column that ranks, and further columns.
    lines : list of (int or None, list of str)
        Rank, None for a method without one, and the texts of the rank, the method, the numbers and the time.
        Methods with equal printed numbers share a rank.
    timed : bool
        Whether a method has a time.
    """

    title: str
    columns: list[Column]
    lines: list[tuple[int | None, list[str]]]
    timed: bool

    @property
    def labels(self) -> list[str]:
        """The headings."""
        return ["rank", "method", *(column.label for column in self.columns), *["time (s)"] * self.timed]

    def first(self, count: int) -> list[list[str]]:
        """Return the texts of the methods up to a rank."""
        return [texts for rank, texts in self.lines if rank is not None and rank <= count]


def rankings(table: Table, seconds: Mapping[str, float]) -> list[Ranking]:
    """Return the ranking of a track, or one for each kind of its handles.

    Parameters
    ----------
    table : Table
    seconds : mapping
        Method -> time on one machine, with the version of the code that made the table.
    """
    kinds = [part for part in table.parts if part.title.startswith("handles: ")]
    return [_ranking(own.title if kinds else "", own, seconds) for own in kinds or [table]]


def _ranking(title: str, table: Table, seconds: Mapping[str, float]) -> Ranking:
    columns = {
        column.heading: column for column in table.columns if table.means[column.heading].notna().any()
    }
    first = next(heading for heading in RANKING if heading in columns)
    shown = [columns[name] for name in dict.fromkeys([first, *SHOWN]) if name in columns]
    competes = table.lines["competes"].astype(bool)
    printed = table.means.loc[competes, first].dropna().map(columns[first].text).astype(float)
    places = printed.rank(method="min").astype(int)
    lines: list[tuple[int | None, list[str]]] = []
    for method in [*places.sort_values(kind="stable").index, *table.lines.index.difference(places.index)]:
        place, means = places.get(method), table.means.loc[method]
        rank = "-" if place is None else f"{place}{' =' * int((places == place).sum() > 1)}"
        texts = [c.text(means[c.heading]) if means.notna()[c.heading] else "-" for c in shown]
        if place is None and means[first] != means[first]:
            texts[0] = table.lines.loc[method, "outcome"]
        times = [f"{seconds[method]:.3g}" if method in seconds else "-"] * bool(seconds)
        lines.append((None if place is None else int(place), [rank, method, *texts, *times]))
    return Ranking(title, shown, lines, bool(seconds))

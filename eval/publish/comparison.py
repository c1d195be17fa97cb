"""What a table compares: the results of methods over the cases that all of them have.

A case is a task. A method has it where every run of it that has begun has a
result, and its value there is the mean over its seeds; a seed that was only
planned takes nothing from the others. A mean over what a method
happened to finish would flatter the one that lost its hardest cases, so means
are over common cases only; and so that a method which lost most of its own does
not take them from the others, those with the fewest cases are left out until at
least half of all cases are common to the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd

from eval.publish.columns import Column, begun, reference_rows
from eval.rows.frame import method_names, numbers
from eval.rows.store import VALID

#: The levels of values by run: method, case and seed.
RUN = ["method.name", "task.name", "seed"]


@dataclass(frozen=True)
class Comparison:
    """Values of methods over the cases that they have in common.

    Parameters
    ----------
    cases : Index
        Every planned task.
    common : Index
        Those that every method compared has.
    finished : Series
        By method, in a table's order: how many tasks it has.
    ranked : list of str
        The methods compared, without references.
    runs : DataFrame
        The rows that count: of the methods compared, references too, on the common cases.
    values : DataFrame
        By method and task, a column a heading: means over seeds; NaN where one lacks the number.
    spread : DataFrame
        By method: standard deviation over seeds of the mean over the cases; NaN without a second seed.
    """

    cases: pd.Index
    common: pd.Index
    finished: pd.Series
    ranked: list[str]
    runs: pd.DataFrame
    values: pd.DataFrame
    spread: pd.DataFrame

    @property
    def compared(self) -> list[str]:
        """The methods that have means, references too."""
        return method_names(self.runs)


def compare(rows: pd.DataFrame, columns: Sequence[Column]) -> Comparison:
    """Find the common cases of the rows' methods, and their values there."""
    ended = begun(rows)
    by_case = ended["status"].isin(VALID).groupby([ended["method.name"], ended["task.name"]]).all()
    cases = pd.Index(sorted(rows["task.name"].unique()), name="task.name")
    complete = by_case.unstack(fill_value=False).reindex(method_names(rows), columns=cases, fill_value=False)
    references = set(rows["method.name"][reference_rows(rows)])
    rivals = complete.drop(index=references)
    chosen, common = _common(rivals if len(rivals) else complete)
    candidates = [name for name in complete.index if name in references or name in chosen]
    compared = [name for name in candidates if len(common) and complete.loc[name, common].all()]
    runs = ended[ended["method.name"].isin(compared) & ended["task.name"].isin(common)]
    of_runs = pd.DataFrame({column.heading: numbers(runs, column.source) for column in columns})
    of_runs.index = pd.MultiIndex.from_frame(runs[RUN])
    return Comparison(
        cases=complete.columns,
        common=common,
        finished=complete.sum(axis=1),
        ranked=[name for name in compared if name not in references],
        runs=runs,
        values=means(of_runs, RUN[:2]),
        spread=_spread(of_runs, cases=len(common)),
    )


def _common(complete: pd.DataFrame) -> tuple[list[str], pd.Index]:
    """The methods to compare and the cases that all of them have.

    Parameters
    ----------
    complete : DataFrame of bool
        Whether a method (line) has a task (column).
    """
    counts = complete.sum(axis=1)
    counts = counts[counts > 0]
    if counts.empty:
        return [], complete.columns[:0]
    while True:
        common = complete.columns[complete.loc[counts.index].all()]
        if 2 * len(common) >= len(complete.columns) or counts.min() == counts.max():
            return list(counts.index), common
        counts = counts[counts > counts.min()]


def means(values: pd.DataFrame, levels: str | list[str]) -> pd.DataFrame:
    """Means by levels of the index; NaN where one of the values is."""
    groups = values.groupby(level=levels)
    return groups.mean().where(groups.count().eq(groups.size(), axis=0))


def _spread(of_runs: pd.DataFrame, *, cases: int) -> pd.DataFrame:
    """By method, over the seeds that it has for every case; see :class:`Comparison`."""
    method_seed = [RUN[0], RUN[2]]
    everywhere = of_runs.groupby(level=method_seed).size() == cases
    return means(of_runs, method_seed)[everywhere].groupby(level=RUN[0]).std()

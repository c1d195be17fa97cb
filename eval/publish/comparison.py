"""Compare methods over the cases that all of them have.

A case is a task. A method has a case if all begun runs of the method on the task have a result; its value is
the mean over the seeds. Means are over common cases only: otherwise a method that failed on the hardest cases
would look better. Methods with the fewest cases are left out until the remaining methods have at least half
of all cases in common. A method with few results therefore removes no cases of other methods.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import pandas as pd

from eval.publish.columns import Column, begun, reference_rows
from eval.publish.intervals import Resampling
from eval.rows.frame import method_names, numbers
from eval.rows.store import VALID

#: Columns that identify a run.
RUN = ["method.name", "task.name", "seed"]


class Comparison(NamedTuple):
    """Values of methods over their common cases.

    Parameters
    ----------
    cases : Index
        All tasks.
    common : Index
        Tasks that every compared method has.
    finished : Series
        Number of tasks of each method, in the order of the table.
    ranked : list of str
        The compared methods, without references.
    runs : DataFrame
        Rows of the compared methods and references on the common cases.
    values : DataFrame
        Means over seeds, by method and task; NaN if a seed lacks the number. One column per heading.
    resampling : Resampling
        The resamples of the common cases, for intervals.
    spread : DataFrame
        Standard deviation over seeds of the mean over the cases, by method; NaN without a second seed.
    """

    cases: pd.Index
    common: pd.Index
    finished: pd.Series
    ranked: list[str]
    runs: pd.DataFrame
    values: pd.DataFrame
    resampling: Resampling
    spread: pd.DataFrame

    @property
    def compared(self) -> list[str]:
        """The compared methods and references."""
        return method_names(self.runs)


def compare(rows: pd.DataFrame, columns: Sequence[Column]) -> Comparison:
    """Find the common cases of the methods, and their values on these cases."""
    ended = begun(rows)
    by_case = ended["status"].isin(VALID).groupby([ended["method.name"], ended["task.name"]]).all()
    cases = pd.Index(sorted(rows["task.name"].unique()), name="task.name")
    complete = by_case.unstack(fill_value=False).reindex(method_names(rows), columns=cases, fill_value=False)
    references = set(rows["method.name"][reference_rows(rows)])
    rivals = complete.drop(index=references)
    methods, common = _common(rivals if len(rivals) else complete)
    candidates = [name for name in complete.index if name in references or name in methods]
    compared = [name for name in candidates if len(common) and complete.loc[name, common].all()]
    runs = ended[ended["method.name"].isin(compared) & ended["task.name"].isin(common)]
    of_runs = pd.DataFrame({column.heading: numbers(runs, column.source) for column in columns})
    of_runs.index = pd.MultiIndex.from_frame(runs[RUN])
    values = means(of_runs, RUN[:2])
    subjects, poses = subjects_of(rows), poses_of(rows)
    return Comparison(
        cases=complete.columns,
        common=common,
        finished=complete.sum(axis=1),
        ranked=[name for name in compared if name not in references],
        runs=runs,
        values=values,
        resampling=Resampling.of([subjects[task] for task in common], [poses[task] for task in common]),
        spread=_spread(of_runs, cases=len(common)),
    )


def subjects_of(rows: pd.DataFrame) -> dict[str, str]:
    """Return the subject of each task.

    Datasets number their subjects: a body, an animal or a shape is one subject, in all of its poses and with
    all kinds of handles. The subject of any other task is the first part of its name, the name of the mesh.
    """
    facts = _facts(rows, ["task.meta.subject"])
    return {task: task.split("/")[0] if pd.isna(own) else str(own) for task, own in facts.itertuples()}


def poses_of(rows: pd.DataFrame) -> dict[str, str]:
    """Return the pose of each task: its name in the source of the dataset, otherwise its number.

    Poses of one name are one pose, also of several subjects. A task without either is a pose of its own.
    """
    facts = _facts(rows, ["task.meta.source_pose", "task.meta.pose"])
    return {
        task: str(next((own for own in names if not pd.isna(own)), task))
        for task, *names in facts.itertuples()
    }


def _facts(rows: pd.DataFrame, columns: list[str]) -> pd.DataFrame:
    """Return columns of each task; the first value of each counts, because missing runs have none."""
    return rows.reindex(columns=["task.name", *columns]).groupby("task.name").first()


def _common(complete: pd.DataFrame) -> tuple[list[str], pd.Index]:
    """Return the methods to compare and their common cases.

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
    """Return means by levels of the index; NaN if a value of the group is NaN."""
    groups = values.groupby(level=levels)
    return groups.mean().where(groups.count().eq(groups.size(), axis=0))


def _spread(of_runs: pd.DataFrame, *, cases: int) -> pd.DataFrame:
    """Return the standard deviation by method, over the seeds that cover all cases."""
    method_seed = [RUN[0], RUN[2]]
    everywhere = of_runs.groupby(level=method_seed).size() == cases
    return means(of_runs, method_seed)[everywhere].groupby(level=RUN[0]).std()

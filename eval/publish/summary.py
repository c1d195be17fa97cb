"""The numbers of a table from rows: one line per method, with means over the common cases.

Differences to a reference method and ranks count subjects and poses (:mod:`eval.publish.intervals`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd

from eval.publish.columns import (
    REFERENCES,
    SUCCESS,
    TRUTH,
    Column,
    are_transfers,
    begun,
    columns_of,
    with_missing,
    with_success,
)
from eval.publish.comparison import Comparison, compare, means
from eval.publish.intervals import differences, places, reference_of
from eval.publish.notes import case_notes, common_notes, rank_note, require_one_version, version_note
from eval.rows.frame import CASE, distinct, method_names, numbers, of_methods, valid
from eval.rows.splits import HELD_OUT, TUNING, split_of
from eval.rows.store import TRUE_POSE, VALID
from sshade.core.errors import InputError

#: Smallest number of common cases for the table of worst cases.
LEAST_CASES = 4
#: Title of the second table of a method's measures.
FURTHER = "further measures"
#: Halves of the benchmark and their titles. The first half with rows is the headline.
HALVES = {HELD_OUT: "held-out cases", None: "cases of neither half", TUNING: "tuning cases"}


class Table(NamedTuple):
    """The numbers of a table, its notes, and tables of parts of the rows.

    Parameters
    ----------
    title : str
    columns : sequence of Column
        Columns of the first and of the second table.
    lines : DataFrame
        By method: ``runs``, with missing ones; ``valid``, runs with a result; ``cases`` of the means;
        ``converged``, such as "5/8", or "-" for methods without a stopping rule; ``outcome``, printed if
        there are no means; ``competes``, whether the method is ranked.
    means : DataFrame
        By method and heading, over the common cases; NaN if a case lacks the number.
    spread : DataFrame
        By method and heading: standard deviation of the mean over seeds; NaN without a second seed.
    places : DataFrame
        By method and heading: rank, NaN without one.
    differences : dict
        Heading -> by method, the columns of :func:`eval.publish.intervals.differences`. Empty if there are
        too few subjects, poses or methods.
    reference : str
        Method to which the differences are.
    over : str
        Units of the intervals, such as "5 subjects and 6 poses".
    notes : list of str
    parts : sequence of Table
    label : str
        Half of the benchmark that the cases belong to; may be empty.
    """

    title: str
    columns: Sequence[Column]
    lines: pd.DataFrame
    means: pd.DataFrame
    spread: pd.DataFrame
    places: pd.DataFrame
    differences: Mapping[str, pd.DataFrame] = {}
    reference: str = ""
    over: str = ""
    notes: Sequence[str] = ()
    parts: Sequence[Table] = ()
    label: str = ""

    @property
    def heading(self) -> str:
        """The title, with the half of the benchmark."""
        return f"{self.title}: {self.label}" if self.label else self.title

    @property
    def views(self) -> list[tuple[str, list[Column]]]:
        """Headings and columns of the tables to print: the paper's measures, and further measures."""
        first = [column for column in self.columns if not column.further]
        further = [column for column in self.columns if column.further]
        views = ((self.heading, first), (f"{self.title}: {FURTHER}", further))
        return [view for view in views if view[1]]

    @property
    def nearer(self) -> pd.Series | None:
        """By method: the cases in which it is nearer to the true pose than the reference, such as "29/40"."""
        truth = next((column.heading for column in self.columns if column.source == TRUTH), None)
        if (
            truth is None
            or truth not in self.differences
            or self.differences[truth]["difference"].isna().all()
        ):
            return None
        cases = self.lines["cases"].max()
        return self.differences[truth]["smaller"].map(f"{{:d}}/{cases}".format)

    @property
    def difference_view(self) -> tuple[str, list[Column]] | None:
        """Heading and columns of the table of differences, None if there are no differences."""
        if not self.differences:
            return None
        heading = f"{self.title}: difference to {self.reference}, with its 95 % interval over {self.over}"
        found = {name for name, own in self.differences.items() if own["difference"].notna().any()}
        return heading, [column for column in self.columns if column.main and column.heading in found]


def make_table(rows: pd.DataFrame, *, title: str, reference: str | None = None) -> Table:
    """Make a table from the rows of an experiment.

    Parameters
    ----------
    rows : DataFrame
        The rows of a method must come from one configuration.
    title : str
    reference : str, optional
        Method to which differences are shown. By default Elastic if it is there, otherwise the first method.

    Raises
    ------
    InputError
        If the rows are of several datasets, the rows of a method have different configurations or versions
        or repeat a run, or the reference has no rank.
    """
    every, rows = rows, of_methods(rows)
    true_poses = valid(every).drop(rows.index, errors="ignore")
    _check_one_experiment(rows)
    if reference not in (None, *rows["method.name"]):
        raise InputError(f"{title} has no method {reference!r}; it has {', '.join(method_names(rows))}")
    require_one_version(rows)
    table_of = partial(_table, reference=reference, true_poses=true_poses)
    transfers = are_transfers(rows)
    rows = rows if transfers else with_success(rows)
    columns = columns_of(rows)
    (half, first), *others = [(half, with_missing(own)) for half, own in by_half(rows).items()]
    comparison = compare(first, columns)
    named = _parts(first, comparison.common)
    parts = [table_of(name, columns, part, compare(part, columns)) for name, part in named.items()]
    parts += [] if transfers else worst_case(comparison, first, columns)
    for other, own in others:
        of_other = compare(own, columns)
        part = table_of(HALVES[other], columns, own, of_other)
        parts.append(part._replace(notes=[*case_notes(own, of_other, half=other), *part.notes]))
    table = table_of(title, columns, first, comparison)
    if table.differences and reference not in (None, table.reference):
        raise InputError(
            f"{title} has no differences to {reference!r}, which is not ranked; name one of "
            f"{', '.join(comparison.ranked)}"
        )
    notes = [*case_notes(first, comparison, half=half), *table.notes, version_note(every)]
    notes += common_notes(rows, columns=columns)
    if any(column.source == TRUTH for column in columns) and not transfers:
        missing = "its rows are not one for each case." if len(true_poses) else "not measured here."
        known = REFERENCES["eval.metrics.measure"] if TRUE_POSE in table.lines.index else missing
        notes.append(f"{TRUE_POSE}: {known}")
    return table._replace(notes=notes, parts=parts, label=HALVES[half] if half else "")


def by_half(rows: pd.DataFrame) -> dict[str | None, pd.DataFrame]:
    """Split rows by the halves of the benchmark that they have, the headline first."""
    splits = rows["task.name"].map(split_of)
    halves = {half: rows[splits.isna() if half is None else splits == half] for half in HALVES}
    return {half: own for half, own in halves.items() if len(own)}


def worst_case(comparison: Comparison, rows: pd.DataFrame, columns: Sequence[Column]) -> list[Table]:
    """Return the table of the worst case of each method, without ranks.

    Methods without means and references take no part.
    """
    methods = comparison.ranked
    if len(comparison.common) < LEAST_CASES or len(methods) < 2:
        return []
    columns = [column for column in columns if column.source != SUCCESS]
    values = comparison.values.groupby(level="method.name")
    worst = values.max().where(values.count().eq(values.size(), axis=0)).loc[methods]
    lines = _lines(rows, comparison).loc[methods]
    return [Table("worst case", columns, lines, worst, worst * np.nan, worst * np.nan)]


def _parts(rows: pd.DataFrame, common: pd.Index) -> dict[str, pd.DataFrame]:
    """Split rows by the kind of handles; rows of pose transfers by class, pose and edit.

    Each kind of handles has common cases of its own, because a method may accept one kind only. Rows of pose
    transfers are split by pose only if every class has the same poses.
    """
    if not are_transfers(rows):
        kinds = rows.reindex(columns=["task.meta.handles"])["task.meta.handles"]
        several = kinds.nunique() > 1
        return {f"handles: {kind}": part for kind, part in rows.groupby(kinds)} if several else {}
    rows = begun(rows[rows["task.name"].isin(common)])
    facts = rows.reindex(columns=[f"task.meta.{fact}" for fact in ("class", "source_pose", "edit")])
    facts = facts.set_axis(["class", "pose", "edit"], axis="columns")
    parts: dict[str, pd.DataFrame] = {}
    for fact, values in facts.astype(str).items():
        classes = facts["class"].groupby(values).nunique()
        if values.nunique() > 1 and (fact != "pose" or (classes == facts["class"].nunique()).all()):
            parts |= {f"{fact}: {value}": part for value, part in rows.groupby(values)}
    return parts


def _table(
    title: str,
    columns: Sequence[Column],
    rows: pd.DataFrame,
    comparison: Comparison,
    *,
    true_poses: pd.DataFrame,
    reference: str | None = None,
) -> Table:
    """Return the table of rows and their comparison, with the line of true poses and the note on ranks."""
    lines = _lines(rows, comparison)
    values = means(comparison.values, "method.name").reindex(lines.index)
    if SUCCESS in rows:  # over all runs, also missing ones, not only the common cases
        values[SUCCESS] = rows.groupby("method.name")[SUCCESS].mean()
    spread = comparison.spread.drop(columns=SUCCESS, errors="ignore").reindex(index=lines.index)
    notes = rank_note(comparison, columns)
    table = Table(title, columns, lines, values, spread, values * np.nan, notes=notes)
    return _with_true_pose(_with_differences(table, comparison, reference), comparison, true_poses)


def _with_true_pose(table: Table, comparison: Comparison, rows: pd.DataFrame) -> Table:
    """Add the means of the true poses as the last line, if the rows have one of each common case."""
    rows = rows[rows["task.name"].isin(comparison.common)]
    if not len(rows) or sorted(rows["task.name"]) != sorted(comparison.common):
        return table
    means = {c.heading: numbers(rows, c.source).mean(skipna=False) for c in table.columns}
    facts = {"runs": len(rows), "valid": len(rows), "cases": len(rows), "converged": "-", "competes": False}
    lines = pd.concat([table.lines, pd.DataFrame(facts, index=[TRUE_POSE])]).rename_axis("method.name")
    return table._replace(
        lines=lines,
        means=pd.concat([table.means, pd.DataFrame(means, index=[TRUE_POSE])]),
        spread=table.spread.reindex(lines.index),
        places=table.places.reindex(lines.index),
    )


def _with_differences(table: Table, comparison: Comparison, wanted: str | None) -> Table:
    """Add the differences to a reference and the ranks, if there are enough subjects, poses and methods."""
    methods, resampling = comparison.ranked, comparison.resampling
    if len(methods) < 2 or not resampling.enough:
        return table
    reference = wanted if wanted in methods else reference_of(methods)
    found, ranks = {}, table.places.copy()
    for column in (column for column in table.columns if column.ranked):
        name = column.heading
        of_cases = comparison.values[name].unstack("method.name").loc[comparison.common, methods]
        found[name] = differences(of_cases, reference, resampling, decimals=column.decimals)
        ranks[name] = places(of_cases, resampling, column)
    return table._replace(places=ranks, differences=found, reference=reference, over=str(resampling))


def _lines(rows: pd.DataFrame, comparison: Comparison) -> pd.DataFrame:
    """Return the lines of a :class:`Table`."""
    status = rows.groupby("method.name")["status"]
    lines = pd.DataFrame({"runs": status.size(), "valid": status.agg(lambda own: own.isin(VALID).sum())})
    lines["cases"] = [len(comparison.common) * (name in comparison.compared) for name in lines.index]
    lines["converged"] = comparison.runs.groupby("method.name")["converged"].agg(converged_runs)
    lost = rows[~rows["status"].isin(VALID)].groupby("method.name")["status"]
    lines["outcome"] = lost.agg(lambda own: own.mode()[0])
    lines = lines.fillna({"converged": "-", "outcome": "too few"})
    lines["competes"] = lines.index.isin(comparison.ranked)
    return lines.loc[method_names(rows)]


def converged_runs(converged: pd.Series) -> str:
    """Return converged runs / runs with a stopping rule, such as "5/8"; "-" if there are no such runs."""
    rule = converged.dropna()
    return f"{int(rule.sum())}/{len(rule)}" if len(rule) else "-"


def ranks(table: Table, heading: str) -> dict[str, int]:
    """Return method -> 1 (best) or 2 (second best); empty if all methods share a rank."""
    place = table.places[heading].dropna().rank(method="dense").astype(int)
    return place[place <= 2].to_dict() if place.nunique() > 1 else {}


def _check_one_experiment(rows: pd.DataFrame) -> None:
    """Raise InputError if rows mix datasets or configurations of a method, or repeat a run."""
    datasets = distinct(rows, "task.meta.dataset")
    if len(datasets) > 1:
        raise InputError(
            f"the rows are of {len(datasets)} datasets ({', '.join(datasets)}), and means over several "
            "datasets say nothing: run each dataset under another name, run.experiment=..."
        )
    started = begun(rows)
    hashes = started.groupby("method.name")["method.hash"].nunique()
    if hashes.max() > 1:
        own = started[started["method.name"] == hashes.idxmax()].filter(regex=r"^method\.(?!hash|note)")
        values = {name.removeprefix("method."): found.map(str).unique() for name, found in own.items()}
        differ = [f"{name} {' and '.join(found)}" for name, found in values.items() if len(found) > 1]
        raise InputError(
            f"method {hashes.idxmax()!r} has rows of different parameters ({'; '.join(differ[:3])}): give "
            "each another label=..., or remove the folders of the old runs"
        )
    repeated = rows[rows.duplicated(["method.name", *CASE])].sort_values(["method.name", *CASE])
    if len(repeated):
        name, task, seed = repeated.iloc[0][["method.name", *CASE]]
        raise InputError(
            f"method {name!r} has several rows for {task}, seed {seed} (two resolutions, or two copies of "
            "the dataset?): collect them as separate experiments, or remove the old runs"
        )

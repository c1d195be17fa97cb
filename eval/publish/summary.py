"""From rows to the numbers of a table: one line a method, means over the cases that all methods have."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from eval.publish.columns import SUCCESS, Column, are_transfers, begun, columns_of, with_success
from eval.publish.comparison import Comparison, compare, means
from eval.publish.notes import case_notes, common_notes, version_notes
from eval.rows.frame import CASE, distinct, method_names
from eval.rows.splits import HELD_OUT, TUNING, split_of
from eval.rows.store import VALID
from sshade.errors import InputError

#: Fewer common cases than this have no table of the worst and the best of them.
LEAST_CASES = 4

MIXED_HELP = "accept rows of several versions of the code, with a warning"

#: The second table of a title.
HIDDEN = "what means hide"

#: The halves of the benchmark as titles say them, the first that there is for the headline; None for others.
HALVES = {HELD_OUT: "held-out cases", TUNING: "tuning cases", None: "cases of neither half"}


@dataclass(frozen=True)
class Table:
    """The numbers of a table by method, the notes under it, and tables of parts of the rows.

    Parameters
    ----------
    title : str
    columns : tuple of Column
        Of the paper's table and of the second one.
    lines : DataFrame
        By method: ``runs`` that were planned and, with a result, ``valid``; ``cases``, how many the
        means are over; ``converged``, "5/8" of those runs met the stopping rule, "-" for methods
        without one; ``outcome``, why there would be no means; ``competes``, whether it has means and
        is no reference.
    means : DataFrame
        By method and heading, over the common cases; NaN where one of them lacks the number.
    spread : DataFrame
        By method and heading: standard deviation of the mean over seeds, NaN without a second seed.
    notes : list of str
    parts : tuple of Table
    label : str
        Which half of the benchmark the cases are of; empty where they are of neither.
    """

    title: str
    columns: tuple[Column, ...]
    lines: pd.DataFrame
    means: pd.DataFrame
    spread: pd.DataFrame
    notes: list[str]
    parts: tuple[Table, ...] = ()
    label: str = ""

    @property
    def views(self) -> list[tuple[str, tuple[Column, ...]]]:
        """The tables to print, by heading: the paper's columns, and those of what means hide."""
        sides = {
            f"{self.title}: {self.label}" if self.label else self.title: False,
            f"{self.title}: {HIDDEN}": True,
        }
        views = [
            (name, tuple(c for c in self.columns if c.hidden == hidden)) for name, hidden in sides.items()
        ]
        return [(heading, columns) for heading, columns in views if columns]


def make_table(rows: pd.DataFrame, *, title: str, mixed: bool = False) -> Table:
    """Gather rows into a table.

    Parameters
    ----------
    rows : DataFrame
        Of one experiment; a method's rows must come from one configuration.
    title : str
    mixed : bool
        Accept rows of several versions of the code, with a warning among the notes.

    Raises
    ------
    InputError
        When no run has begun, when rows are of several datasets or versions, or a
        method's rows have different configurations or repeat a run.
    """
    if begun(rows).empty:
        raise InputError(
            f"none of the {len(rows)} runs that were planned has begun, so there is no table of them"
        )
    _check_one_experiment(rows)
    versions = version_notes(rows, mixed=mixed)
    if not are_transfers(rows):
        rows = with_success(rows)
    columns = columns_of(rows)
    splits = rows["task.name"].map(split_of)
    of_half = {half: rows[splits.isna() if half is None else splits == half] for half in HALVES}
    (half, first), *others = [(half, own) for half, own in of_half.items() if len(own)]
    comparison = compare(first, columns)
    parts = [
        _table(name, columns, part, compare(part, columns))
        for name, part in _parts(first, comparison.common).items()
    ]
    if not are_transfers(rows):
        parts += contest(comparison, first, columns)
    for other, own in others:
        of_other = compare(own, columns)
        notes = case_notes(own, of_other, half=other)
        parts.append(_table(HALVES[other], columns, own, of_other, notes=notes))
    notes = [*case_notes(first, comparison, half=half), *versions, *common_notes(rows, columns=columns)]
    label = HALVES[half] if half else ""
    return _table(title, columns, first, comparison, notes=notes, parts=tuple(parts), label=label)


def contest(comparison: Comparison, rows: pd.DataFrame, columns: tuple[Column, ...]) -> list[Table]:
    """Of deformations of several cases: each method's worst case, and in how many it is the best.

    The best of a case are those that none prints a lower number than. Only
    methods with means compete; references do not.
    """
    methods, cases = comparison.ranked, len(comparison.common)
    if cases < LEAST_CASES or len(methods) < 2:
        return []
    columns = tuple(column for column in columns if column.source != SUCCESS)
    worst, won = {}, {}
    for column in columns:
        value = comparison.values[column.heading].unstack("method.name")[methods]
        usable = not value.isna().any(axis=None)
        worst[column.heading] = value.max() if usable else np.nan
        if column.ranked:
            printed = value.map(column.text).astype(float)
            best = printed.eq(printed.min(axis=1), axis=0).sum()
            won[column.heading] = best if usable else np.nan
    counts = [replace(c, unit="", decimals=0, ranked=False, scientific=False) for c in columns if c.ranked]
    lines = _lines(rows, comparison).loc[methods]
    return [
        Table(title, tuple(own), lines, numbers_of, numbers_of * np.nan, [])
        for title, own, numbers_of in (
            ("worst case", columns, pd.DataFrame(worst, methods)),
            (f"cases won, of {cases}", counts, pd.DataFrame(won, methods)),
        )
    ]


def _parts(rows: pd.DataFrame, common: pd.Index) -> dict[str, pd.DataFrame]:
    """Rows by kind of handles, or of pose transfers by class, pose and edit, each where there are several.

    A method may take one kind of handles only, so that those compare by the cases of each kind, the others by
    the common ones. By pose only where every class has the same ones: elsewhere a pose is one case.
    """
    if not are_transfers(rows):
        kinds = rows.reindex(columns=["task.meta.handles"])["task.meta.handles"]
        several = kinds.nunique() > 1
        return {f"handles: {kind}": part for kind, part in rows.groupby(kinds)} if several else {}
    rows = begun(rows[rows["task.name"].isin(common)])
    parts = {}
    facts = rows.reindex(columns=[f"task.meta.{fact}" for fact in ("class", "source_pose", "edit")])
    classes = facts["task.meta.class"]
    for fact, values in facts.astype(str).items():
        poses = fact == "task.meta.source_pose"
        everywhere = (classes.groupby(values).nunique() == classes.nunique()).all()
        if values.nunique() > 1 and (everywhere or not poses):
            word = "pose" if poses else fact.rpartition(".")[2]
            parts |= {f"{word}: {value}": part for value, part in rows.groupby(values)}
    return parts


def _table(
    title: str,
    columns: tuple[Column, ...],
    rows: pd.DataFrame,
    comparison: Comparison,
    *,
    notes: list[str] | None = None,
    parts: tuple[Table, ...] = (),
    label: str = "",
) -> Table:
    """A table of rows and of what they are compared by."""
    lines = _lines(rows, comparison)
    values = means(comparison.values, "method.name").reindex(lines.index)
    if SUCCESS in rows:  # a share of what was planned, whatever is common
        values[SUCCESS] = rows.groupby("method.name")[SUCCESS].mean()
    spread = comparison.spread.drop(columns=SUCCESS, errors="ignore").reindex(index=lines.index)
    return Table(title, columns, lines, values, spread, notes or [], parts, label)


def _lines(rows: pd.DataFrame, comparison: Comparison) -> pd.DataFrame:
    """The lines of a :class:`Table`."""
    methods = method_names(rows)
    own = rows.groupby("method.name")["status"]
    lines = pd.DataFrame({"runs": own.size(), "valid": own.agg(lambda status: status.isin(VALID).sum())})
    lines["cases"] = [len(comparison.common) * (name in comparison.compared) for name in lines.index]
    lines["converged"] = comparison.runs.groupby("method.name")["converged"].agg(_share)
    lost = rows[~rows["status"].isin(VALID)].groupby("method.name")["status"]
    lines["outcome"] = lost.agg(lambda status: status.mode()[0])
    lines = lines.fillna({"converged": "-", "outcome": "too few"})
    lines["competes"] = lines.index.isin(comparison.ranked)
    return lines.loc[methods]


def _share(converged: pd.Series) -> str:
    """How many runs met the stopping rule, of those that have one."""
    rule = converged.dropna()
    return f"{int(rule.sum())}/{len(rule)}" if len(rule) else "-"


def ranks(table: Table, column: Column) -> dict[str, int]:
    """Method -> 1 (best) or 2 (second best), by the printed numbers, so that equal ones share a rank.

    Only methods with means compete; references do not.
    """
    if not column.ranked:
        return {}
    printed = table.means.loc[table.lines["competes"], column.heading].dropna().map(column.text).astype(float)
    place = printed.rank(method="dense").astype(int)
    return place[place <= 2].to_dict()


def _check_one_experiment(rows: pd.DataFrame) -> None:
    """Raise InputError where rows mix datasets, a method's configurations, or repeat a case."""
    datasets = distinct(rows, "task.meta.dataset")
    if len(datasets) > 1:
        raise InputError(
            f"the rows are of {len(datasets)} datasets ({', '.join(datasets)}), whose means say nothing "
            "together: run each dataset under a name of its own, run.experiment=..."
        )
    hashes = begun(rows).groupby("method.name")["method.hash"].nunique()
    if hashes.max() > 1:
        raise InputError(
            f"method {hashes.idxmax()!r} has rows of different parameters: give each its own label=..., "
            "or remove the old runs"
        )
    repeated = rows[rows.duplicated(["method.name", *CASE])].sort_values(["method.name", *CASE])
    if len(repeated):
        name, task, seed = repeated.iloc[0][["method.name", *CASE]]
        raise InputError(
            f"method {name!r} has several rows for {task}, seed {seed} (two resolutions, or two copies of "
            "the dataset?): collect them as experiments of their own, or remove the old runs"
        )

"""From rows to the numbers of a table: one line a method, means over its valid runs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from eval.metrics import METRICS
from eval.publish.columns import REFERENCES, Column, are_transfers, columns_of, reference_rows
from eval.rows.frame import CASE, distinct, method_names, method_order, newest, numbers, valid
from sshade.errors import InputError

#: Fewer cases than this have no table of the worst and the best of them.
LEAST_CASES = 4


@dataclass(frozen=True)
class Table:
    """The numbers of a table by method, the notes under it, and tables of parts of the rows.

    Parameters
    ----------
    title : str
    columns : tuple of Column
    lines : DataFrame
        By method: ``runs`` and, with a result, ``valid``; ``converged``, "5/8" met the stopping
        rule, "-" for methods without one; ``outcome``, ok or why there is no result;
        ``competes``, whether it has a result for every case and is no reference.
    means : DataFrame
        By method and heading, over the valid runs; NaN where one of them lacks the number.
    notes : list of str
    parts : tuple of Table
    """

    title: str
    columns: tuple[Column, ...]
    lines: pd.DataFrame
    means: pd.DataFrame
    notes: list[str]
    parts: tuple[Table, ...] = ()


def make_table(rows: pd.DataFrame, *, title: str, with_time: bool = True) -> Table:
    """Gather rows into a table.

    Parameters
    ----------
    rows : DataFrame
        Of one experiment; a method's rows must come from one configuration.
    title : str
    with_time : bool
        False leaves the times out, which is the way to join rows of several machines:
        of equal runs on several machines the latest one counts.

    Raises
    ------
    InputError
        When rows are of several datasets, a method's rows have different
        configurations, or times come from different machines or from runs that
        shared a machine.
    """
    if with_time:
        check_times(rows)
    else:
        rows = newest(rows, across_machines=True)
    _check_one_experiment(rows)
    columns = tuple(
        column
        for column in columns_of(rows)
        if (with_time or column.unit != "s")
        and (not column.optional or numbers(rows, column.source).fillna(0).any())
    )
    parts = tuple(Table(name, columns, *_lines(part, columns), []) for name, part in _parts(rows).items())
    lines, means = _lines(rows, columns)
    parts += contest(rows, lines, columns)
    return Table(title, columns, lines, means, _notes(rows, columns=columns), parts)


def contest(rows: pd.DataFrame, lines: pd.DataFrame, columns: tuple[Column, ...]) -> tuple[Table, ...]:
    """Of deformations of several cases: each method's worst case, and in how many it is the best.

    The best of a case are those that none prints a lower number than. Only
    methods with a result for every case compete; references do not.
    """
    competing = lines[lines["competes"]]
    cases = len(rows[CASE].drop_duplicates())
    if are_transfers(rows) or cases < LEAST_CASES or len(competing) < 2:
        return ()
    results = valid(rows).set_index([*CASE, "method.name"])
    worst, won = {}, {}
    for column in columns:
        value = numbers(results, column.source).unstack("method.name")[competing.index]
        usable = not value.isna().any(axis=None)
        worst[column.heading] = value.max() if usable else np.nan
        won[column.heading] = np.nan
        if usable and column.ranked:
            printed = value.map(column.text).astype(float)
            won[column.heading] = printed.eq(printed.min(axis=1), axis=0).sum()
    counts = tuple(replace(column, unit="", decimals=0, ranked=False, scientific=False) for column in columns)
    return (
        Table("worst case", columns, competing, pd.DataFrame(worst, competing.index), []),
        Table(f"cases won, of {cases}", counts, competing, pd.DataFrame(won, competing.index), []),
    )


def _parts(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Rows of pose transfers by class, pose and edit, each where there are several.

    By pose only where every class has the same ones: elsewhere a pose is one case.
    """
    if not are_transfers(rows):
        return {}
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


def _lines(rows: pd.DataFrame, columns: tuple[Column, ...]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The lines and the means of a :class:`Table`."""
    methods = method_names(rows)
    results = valid(rows)
    means = pd.DataFrame({column.heading: numbers(results, column.source) for column in columns})
    means = means.groupby(results["method.name"]).agg(lambda values: values.mean(skipna=False))
    own = rows.groupby("method.name")
    lines = pd.DataFrame({"runs": own.size(), "outcome": own["status"].first()}).loc[methods]
    of_results = results.groupby("method.name")
    lines["valid"] = of_results.size().reindex(methods, fill_value=0)
    lines["converged"] = of_results["converged"].agg(_share).reindex(methods, fill_value="-")
    every = len(rows[CASE].drop_duplicates())
    references = rows["method.name"][reference_rows(rows)]
    lines["competes"] = (lines["valid"] == every) & ~lines.index.isin(references)
    return lines, means.reindex(methods)


def _share(converged: pd.Series) -> str:
    """How many runs met the stopping rule, of those that have one."""
    rule = converged.dropna()
    return f"{int(rule.sum())}/{len(rule)}" if len(rule) else "-"


def ranks(table: Table, column: Column) -> dict[str, int]:
    """Method -> 1 (best) or 2 (second best), by the printed numbers, so that equal ones share a rank.

    Only methods with a result for every case compete; references do not.
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
    hashes = rows.groupby("method.name")["method.hash"].nunique()
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


def check_times(rows: pd.DataFrame) -> None:
    """Raise InputError unless the times of the rows compare: one machine, one run at a time."""
    timed = valid(rows)
    machines = distinct(timed, "env.machine")
    if len(machines) > 1:
        raise InputError(
            f"the rows come from {len(machines)} machines ({'; '.join(machines)}), whose times do not "
            "compare: make one table for each with --machine, or leave the times out with --no-time"
        )
    shared = timed["env.concurrent"].eq(True).sum()
    if shared:
        raise InputError(
            f"{shared} of {len(timed)} rows come from runs that shared the machine with others, "
            "so their times do not compare: run them one at a time, or leave the times out with --no-time"
        )


def _notes(rows: pd.DataFrame, *, columns: tuple[Column, ...]) -> list[str]:
    """Cases, the dataset's note, machine, failures, the methods' own notes and legend."""
    cases, sizes = rows["task.name"].nunique(), rows["task.vertices"]
    size = " to ".join(f"{n:,}" for n in sorted({sizes.min(), sizes.max()}))
    notes = [f"{cases} case{'s' * (cases > 1)} of {size} vertices; means over the runs with a result."]
    notes += [f"{note}." for note in distinct(rows, "task.meta.note")]
    notes += [f"Machine: {'; '.join(distinct(rows, 'env.machine'))}.", *_load(rows)]
    for status in ("failed", "timeout", "skipped"):
        for name, own in rows[rows["status"] == status].groupby("method.name"):
            notes.append(f"{name}: {len(own)} {status} ({own['reason'].fillna('').min()})")
    notes += _method_notes(rows)
    posed_by = distinct(rows, "task.meta.posed_by")
    notes += [f"The poses come from {', '.join(posed_by)}."] if posed_by else []
    marks = "Best in bold, second best underlined, among methods with a result for every case."
    if any(column.source == "iterations" for column in columns):
        marks += " In brackets after the iterations: runs that converged; the others stopped at the cutoff."
    metrics = {f"metric.{name}": metric.equation for name, metric in METRICS.items()}
    said = {column.heading: column.legend or metrics.get(column.source) for column in columns}
    legend = "; ".join(f"{heading}: {text}" for heading, text in said.items() if text)
    ranked = any(column.ranked and column.unit != "s" for column in columns)
    end = "Lower is better" if ranked else "The pose changes these by itself, and no truth says by how much"
    return [*notes, marks, f"{legend}. {end}."]


def _load(rows: pd.DataFrame) -> list[str]:
    """A warning where other work was on the machine: the load average at a run's start exceeds its cores."""
    load, cores = numbers(rows, "env.load"), numbers(rows, "env.cores")
    crowded = load > cores
    if not crowded.any():
        return []
    return [
        f"Times are loose: {crowded.sum()} of {len(rows)} runs began under a load of more than one process "
        f"a core, up to {load[crowded].max():g} on {cores[crowded].iloc[0]:g} cores."
    ]


def _method_notes(rows: pd.DataFrame) -> list[str]:
    """The notes of methods' configurations, and those on references."""
    facts = rows.reindex(columns=["method.name", "method.note", "method.target"])
    own = facts[["method.name", "method.note"]].replace("", None)
    reference = facts.assign(**{"method.note": facts["method.target"].map(REFERENCES)})
    notes = pd.concat([own, reference[own.columns]]).dropna().drop_duplicates()
    pairs = sorted(notes.to_numpy().tolist(), key=lambda pair: (method_order(pair[0]), pair[1]))
    return [f"{name}: {note}" for name, note in pairs]

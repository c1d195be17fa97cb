"""From rows to the numbers of a table: one line a method, means over its valid runs."""

from __future__ import annotations

import operator
import re
from dataclasses import dataclass, replace

from eval.metrics.metrics import METRICS
from eval.publish.columns import REFERENCES, Column, are_transfers, columns_of, is_reference
from eval.rows.store import VALID, Row, newest
from sshade.errors import InputError

#: Fewer cases than this have no table of the worst and the best of them.
LEAST_CASES = 4


@dataclass(frozen=True)
class Line:
    """A method's line.

    Parameters
    ----------
    method : str
    valid, runs : int
        Runs with a result, and all runs.
    competes : bool
        It has a result for every case, and is no reference.
    converged : str
        "5/8" runs met the stopping rule; "-" for methods without one.
    means : dict
        Heading -> mean over the valid runs, None where it is not available for all of them.
    """

    method: str
    valid: int
    runs: int
    competes: bool
    outcome: str
    converged: str
    means: dict[str, float | None]


@dataclass(frozen=True)
class Table:
    """Lines, the columns they share, the sentences that belong under them, and tables of parts of it."""

    title: str
    columns: tuple[Column, ...]
    lines: list[Line]
    notes: list[str]
    parts: tuple[Table, ...] = ()


def make_table(rows: list[Row], *, title: str, with_time: bool = True) -> Table:
    """Gather rows into a table.

    Parameters
    ----------
    rows : list of rows
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
    _check_dataset(rows)
    if with_time:
        check_times(rows)
    else:
        rows = newest(rows, across_machines=True)
    columns = tuple(
        column
        for column in columns_of(rows)
        if (with_time or column.unit != "s")
        and (not column.optional or any(row.get(column.source) for row in rows))
    )
    parts = tuple(Table(name, columns, _lines(part, columns), []) for name, part in _parts(rows).items())
    lines = _lines(rows, columns)
    return Table(
        title, columns, lines, _notes(rows, columns=columns), (*parts, *contest(rows, lines, columns))
    )


def contest(rows: list[Row], lines: list[Line], columns: tuple[Column, ...]) -> tuple[Table, ...]:
    """Of deformations of several cases: each method's worst case, and in how many it is the best.

    The best of a case are those that none prints a lower number than. Only
    methods with a result for every case compete; references do not.
    """
    competing = [line for line in lines if line.competes]
    cases = sorted({_case(row) for row in rows})
    if are_transfers(rows) or len(cases) < LEAST_CASES or len(competing) < 2:
        return ()
    row_of = {(row["method.name"], _case(row)): row for row in rows if row["status"] in VALID}
    worst: dict[str, dict[str, float | None]] = {line.method: {} for line in competing}
    won: dict[str, dict[str, float | None]] = {line.method: {} for line in competing}
    for column in columns:
        values = {name: [row_of[name, case].get(column.source) for case in cases] for name in worst}
        if any(value is None for own in values.values() for value in own):
            for name in worst:
                worst[name][column.heading] = won[name][column.heading] = None
            continue
        printed = {name: [float(column.text(value)) for value in values[name]] for name in worst}
        lowest = [min(numbers) for numbers in zip(*printed.values(), strict=True)]
        for name in worst:
            worst[name][column.heading] = max(values[name])
            count = sum(map(operator.eq, printed[name], lowest))
            won[name][column.heading] = count if column.ranked else None
    counts = tuple(replace(column, unit="", decimals=0, ranked=False, scientific=False) for column in columns)
    return (
        Table("worst case", columns, [replace(line, means=worst[line.method]) for line in competing], []),
        Table(
            f"cases won, of {len(cases)}",
            counts,
            [replace(line, means=won[line.method]) for line in competing],
            [],
        ),
    )


def _parts(rows: list[Row]) -> dict[str, list[Row]]:
    """Rows of pose transfers by class, pose and edit, each where there are several.

    By pose only where every class has the same ones: elsewhere a pose is one case.
    """
    if not are_transfers(rows):
        return {}
    parts = {}
    classes = {row.get("task.meta.class") for row in rows}
    for fact in ("class", "source_pose", "edit"):
        of_value: dict[str, list[Row]] = {}
        for row in rows:
            of_value.setdefault(str(row.get(f"task.meta.{fact}")), []).append(row)
        everywhere = all(
            {row.get("task.meta.class") for row in part} == classes for part in of_value.values()
        )
        if len(of_value) > 1 and (fact != "source_pose" or everywhere):
            word = fact.removeprefix("source_")
            parts |= {f"{word}: {value}": of_value[value] for value in sorted(of_value)}
    return parts


def _lines(rows: list[Row], columns: tuple[Column, ...]) -> list[Line]:
    cases = {_case(row) for row in rows}
    return [
        _line(name, [row for row in rows if row["method.name"] == name], cases=cases, columns=columns)
        for name in method_names(rows)
    ]


def method_names(rows: list[Row]) -> list[str]:
    """The methods of rows, in a table's order."""
    return sorted({row["method.name"] for row in rows}, key=_place)


def ranks(table: Table, column: Column) -> dict[str, int]:
    """Method -> 1 (best) or 2 (second best), by the printed numbers, so that equal ones share a rank.

    Only methods with a result for every case compete; references do not.
    """
    if not column.ranked:
        return {}
    printed = {
        line.method: column.text(line.means[column.heading])
        for line in table.lines
        if line.means[column.heading] is not None and line.competes
    }
    order = sorted(set(printed.values()), key=float)
    return {method: order.index(text) + 1 for method, text in printed.items() if text in order[:2]}


def _check_dataset(rows: list[Row]) -> None:
    datasets = sorted({row["task.meta.dataset"] for row in rows if row.get("task.meta.dataset")})
    if len(datasets) > 1:
        raise InputError(
            f"the rows are of {len(datasets)} datasets ({', '.join(datasets)}), whose means say nothing "
            "together: run each dataset under a name of its own, run.experiment=..."
        )


def check_times(rows: list[Row]) -> None:
    """Raise InputError unless the times of the rows compare: one machine, one run at a time."""
    timed = [row for row in rows if row["status"] in VALID]
    machines = sorted({row["env.machine"] for row in timed})
    if len(machines) > 1:
        raise InputError(
            f"the rows come from {len(machines)} machines ({'; '.join(machines)}), whose times do not "
            "compare: make one table for each with --machine, or leave the times out with --no-time"
        )
    shared = sum(1 for row in timed if row["env.concurrent"])
    if shared:
        raise InputError(
            f"{shared} of {len(timed)} rows come from runs that shared the machine with others, "
            "so their times do not compare: run them one at a time, or leave the times out with --no-time"
        )


def _place(name: str) -> tuple[bool, list[str | float]]:
    """Where a method stands: ours last, the others by name, numbers in it as such (7000 before 25000)."""
    parts: list[str | float] = list(re.split(r"(\d+(?:\.\d+)?)", name))
    parts[1::2] = map(float, parts[1::2])
    return name.startswith("sshade"), parts


def _case(row: Row) -> tuple[str, int]:
    return row["task.name"], row["seed"]


def _line(name: str, rows: list[Row], *, cases: set[tuple[str, int]], columns: tuple[Column, ...]) -> Line:
    if len({row["method.hash"] for row in rows}) > 1:
        raise InputError(
            f"method {name!r} has rows of different parameters: give each its own label=..., "
            "or remove the old runs"
        )
    repeated = {_case(row) for row in rows if [_case(other) for other in rows].count(_case(row)) > 1}
    if repeated:
        task, seed = min(repeated)
        raise InputError(
            f"method {name!r} has several rows for {task}, seed {seed} (two resolutions, or two copies of "
            "the dataset?): collect them as experiments of their own, or remove the old runs"
        )
    valid = [row for row in rows if row["status"] in VALID]
    means: dict[str, float | None] = {}
    for column in columns:
        values = [row.get(column.source) for row in valid]
        usable = bool(values) and None not in values
        means[column.heading] = sum(values) / len(values) if usable else None
    rule = [row["converged"] for row in valid if row["converged"] is not None]
    return Line(
        method=name,
        valid=len(valid),
        runs=len(rows),
        competes={_case(row) for row in valid} == cases and not any(map(is_reference, rows)),
        outcome="ok" if valid else rows[0]["status"],
        converged=f"{sum(rule)}/{len(rule)}" if rule else "-",
        means=means,
    )


def _load(rows: list[Row]) -> list[str]:
    """A warning where other work was on the machine: the load average at a run's start exceeds its cores."""
    crowded = [row for row in rows if (row.get("env.load") or 0) > (row.get("env.cores") or float("inf"))]
    if not crowded:
        return []
    highest = max(row["env.load"] for row in crowded)
    return [
        f"Times are loose: {len(crowded)} of {len(rows)} runs began under a load of more than one process "
        f"a core, up to {highest:g} on {crowded[0]['env.cores']:g} cores."
    ]


def _notes(rows: list[Row], *, columns: tuple[Column, ...]) -> list[str]:
    """Cases, the dataset's note, machine, failures, the methods' own notes and legend."""
    cases = {row["task.name"] for row in rows}
    low, high = (bound(row["task.vertices"] for row in rows) for bound in (min, max))
    size = f"{low:,}" if low == high else f"{low:,} to {high:,}"
    plural = "" if len(cases) == 1 else "s"
    notes = [f"{len(cases)} case{plural} of {size} vertices; means over the runs with a result."]
    notes += sorted({f"{row['task.meta.note']}." for row in rows if row.get("task.meta.note")})
    machines = sorted({row["env.machine"] for row in rows})
    notes.append(f"Machine: {'; '.join(machines)}.")
    notes += _load(rows)
    for status in ("failed", "timeout", "skipped"):
        by_method: dict[str, list[str]] = {}
        for row in rows:
            if row["status"] == status:
                by_method.setdefault(row["method.name"], []).append(row["reason"])
        notes += [
            f"{name}: {len(reasons)} {status} ({sorted(set(reasons))[0]})"
            for name, reasons in sorted(by_method.items())
        ]
    own = {(row["method.name"], row["method.note"]) for row in rows if row.get("method.note")}
    own |= {(row["method.name"], REFERENCES[row["method.target"]]) for row in rows if is_reference(row)}
    notes += [f"{name}: {note}" for name, note in sorted(own, key=lambda pair: (_place(pair[0]), pair[1]))]
    posed_by = sorted({row["task.meta.posed_by"] for row in rows if row.get("task.meta.posed_by")})
    notes += [f"The poses come from {', '.join(posed_by)}."] if posed_by else []
    marks = "Best in bold, second best underlined, among methods with a result for every case."
    if any(column.source == "iterations" for column in columns):
        marks += " In brackets after the iterations: runs that converged; the others stopped at the cutoff."
    notes.append(marks)
    metrics = {f"metric.{name}": metric.equation for name, metric in METRICS.items()}
    said = {column.heading: column.legend or metrics.get(column.source) for column in columns}
    legend = "; ".join(f"{heading}: {text}" for heading, text in said.items() if text)
    if any(column.ranked and column.unit != "s" for column in columns):
        return [*notes, f"{legend}. Lower is better."]
    return [*notes, f"{legend}. The pose changes these by itself, and no truth says by how much."]

"""The sentences below a table: versions, cases and methods of its numbers, and missing results."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache

import pandas as pd
import yaml

from eval.metrics import METRICS
from eval.publish.columns import (
    DEFINITIONS,
    REFERENCES,
    SUCCESS,
    TRANSFER_COLUMNS,
    TRUTH,
    Column,
    begun,
    reference_rows,
)
from eval.publish.comparison import Comparison, subjects_of
from eval.publish.intervals import LEAST
from eval.rows.files import method_files
from eval.rows.frame import distinct, method_order, numbers, of_methods
from eval.rows.splits import HELD_OUT, TUNING
from eval.rows.store import VALID
from sshade.core.errors import InputError, counted

#: Notes on the halves of the benchmark.
HALF_NOTES = {
    HELD_OUT: "Held-out cases: no constant of the project's methods was chosen on them.",
    TUNING: "Tuning cases: constants of methods were chosen on them.",
    None: "Cases of neither half: a tuning case shares their body or pose, or the data are a reader's own.",
}
#: Note on poses rebuilt from samples.
REBUILT_NOTE = (
    "The paper gives d_H 5.66e-3 and d_C 3.76e-8 for triangle frames on TOSCA's classes without wolf and "
    "gorilla (6000 samples, 10 samplings). They were not reproduced: by the definitions below, 66 poses "
    "of seven classes have 9.4e-3 and 3.0e-7, measured outside. Errors of other poses do not compare."
)
#: Note on transfers of edited shapes.
TRANSFERRED_NOTE = (
    "The paper shows pictures of pose transfers and gives their time, about 2 s a mesh, but no errors."
)
#: Settings of iterations that a table names, with their words.
SETTINGS = {
    "start": "Start of iterations",
    "tolerance": "Tolerance",
    "max_iterations": "Cutoff of iterations",
}
#: Value of ``task.meta.edit`` of a transfer without an edit.
UNEDITED = "none"
#: Largest number of names in a note, and of characters of a reason.
LISTED, REASON = 4, 160


def shortened(names: Iterable[str]) -> str:
    """List the first :data:`LISTED` names, and count the others."""
    names = list(names)
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more


def version_note(rows: pd.DataFrame) -> str:
    """Return the note on the commits of rows, and on versions of methods other than the first."""
    started = begun(rows)
    commits = values_of_lines(started, "env.commit") or "unknown"
    modified = " (with changes)" if True in distinct(rows, "env.modified") else ""
    methods = of_methods(started).groupby("method.name")
    versions = methods["method.version"].max()
    later = [f"{name} {version}" for name, version in versions.items() if version > 1]
    current = current_versions()
    # A label may hide which of our methods a row has.
    ours = dict(methods["method.method"].first()) if "method.method" in rows else {}
    newest = {name: current.get(name, current.get(str(ours.get(name)), 0)) for name in versions.index}
    old = [name for name, version in versions.items() if version < newest[name]]
    text = f"Commit: {commits}{modified}. Version of methods: {', '.join(['1', *later])}."
    return text + (f" Of an older version than today's code: {shortened(old)}." if old else "")


def values_of_lines(rows: pd.DataFrame, column: str) -> str:
    """Return the value of a column that most lines have, and other values with the names of their lines.

    A text has eight letters, as a commit.
    """
    values = rows.reindex(columns=[column])[column].dropna()
    values = values.map(lambda value: value[:8] if isinstance(value, str) else f"{value:g}")
    lines = rows["method.name"].groupby(values).unique()
    first, *others = sorted(lines.items(), key=lambda pair: -len(pair[1])) or [("", [])]
    return "; ".join([first[0], *(f"{value} ({', '.join(names)})" for value, names in others)])


@cache
def current_versions() -> dict[str, int]:
    """Return the version of each method in conf/method."""
    files = method_files().values()
    return {path.stem: yaml.safe_load(path.read_text("utf-8")).get("version", 1) for path in files}


def require_one_version(rows: pd.DataFrame) -> None:
    """Raise InputError if the rows of a method are of several versions, or the measures are."""
    for method, own in begun(rows).groupby("method.name"):
        if len(found := distinct(own, "method.version")) > 1:
            versions = " and ".join(map(str, found))
            raise InputError(
                f"method {method!r} has rows of the versions {versions}, which do not compare: run the older "
                "ones again, or remove the folders of their runs"
            )
    if len(found := distinct(rows, "measures")) > 1:
        versions = " and ".join(map(str, found))
        raise InputError(f"the rows are of the versions {versions} of the measures: run the older ones again")


def case_notes(rows: pd.DataFrame, comparison: Comparison, *, half: str | None) -> list[str]:
    """Return notes on the cases of the means, missing results by method, and seeds."""
    cases, common = len(comparison.cases), len(comparison.common)
    sizes = numbers(rows, "task.vertices").dropna().astype(int)
    size = " to ".join(f"{n:,}" for n in sorted({sizes.min(), sizes.max()})) if len(sizes) else "unknown"
    over = "all of them"
    if common < cases:
        over = f"{common} of {cases}, the cases for which every compared method has a result"
    subjects = len({*subjects_of(rows).values()})
    count = f"{subjects} subject{'s' * (subjects > 1)}"
    notes = [f"{counted(cases, 'case', 'cases')} of {size} vertices, {count}; means over {over}."]
    tasks = begun(rows).reindex(columns=["task.name", "task.checksum"]).groupby("task.name").nunique()
    if several := list(tasks.index[tasks["task.checksum"] > 1]):
        notes.append(
            "One name stands for several tasks (resolutions, builds of the data, or makes of processor), "
            f"whose numbers may not be comparable: {shortened(several)}."
        )
    notes.append(HALF_NOTES[half])
    few = comparison.finished.drop(index={*comparison.compared, *rows["method.name"][reference_rows(rows)]})
    few = [f"{name} ({count} of {cases})" for name, count in few[few > 0].items()]
    if few:
        reason = "with them, fewer than half of the cases would be common to all"
        notes.append(f"Without means and ranks, because {reason}: {', '.join(few)}.")
    notes += _lost(rows)
    seeds = rows.groupby("method.name")["seed"].nunique()
    if seeds.max() > 1:
        counts = "; ".join(f"{count} of {shortened(own.index)}" for count, own in seeds.groupby(seeds))
        notes.append(
            f"Seeds: {counts}. The value of a case is the mean over its seeds; ± is the standard deviation "
            "over seeds of the mean over the cases."
        )
    return notes


def _lost(rows: pd.DataFrame) -> list[str]:
    """Return notes on runs without a result: number by method, most frequent reason, cases."""
    notes = []
    lost = rows[~rows["status"].isin(VALID)]
    for (status, name), own in lost.groupby(["status", "method.name"]):
        reasons = own["reason"].fillna("").value_counts().index
        reason = reasons[0] if len(reasons[0]) <= REASON else f"{reasons[0][:REASON]}..."
        reason += " and other reasons" * (len(reasons) > 1)
        every = len(own) == (rows["method.name"] == name).sum()
        where = "every case" if every else shortened(sorted(own["task.name"].unique()))
        notes.append(f"{name}: {len(own)} {status} ({reason}): {where}.")
    return notes


def common_notes(rows: pd.DataFrame, *, columns: Sequence[Column]) -> list[str]:
    """Return the notes on dataset, machine and methods, and the legend."""
    notes = [f"{note}." for note in distinct(rows, "task.meta.note")]
    notes += [f"Machine: {'; '.join(distinct(rows, 'env.machine'))}.", *_method_notes(rows)]
    libraries = [name for name in rows if name.startswith("env.version.")]
    several = {name: found for name in libraries if len(found := distinct(rows, name)) > 1}
    notes += [f"Versions of {name.split('.')[-1]}: {', '.join(found)}." for name, found in several.items()]
    for name, words in SETTINGS.items():
        if values := values_of_lines(begun(rows), f"method.{name}"):
            notes.append(f"{words}: {values}.")
    posed_by = distinct(rows, "task.meta.posed_by")
    notes += [f"The poses come from {', '.join(posed_by)}."] if posed_by else []
    if edits := distinct(rows, "task.meta.edit"):
        notes.append(REBUILT_NOTE if edits == [UNEDITED] else TRANSFERRED_NOTE)
    if any(column.source == "iterations" for column in columns):
        notes.append("In brackets after the iterations: converged runs; the others stopped at the cutoff.")
    return [*notes, legend(columns)]


def rank_note(comparison: Comparison, columns: Sequence[Column]) -> list[str]:
    """Return the note on ranks, or on why there are none; nothing if there is nothing to rank."""
    if len(comparison.ranked) < 2 or not any(column.ranked for column in columns):
        return []
    over = str(comparison.resampling)
    if not comparison.resampling.enough:
        least = " and ".join(f"{LEAST[name]} {name}" for name in comparison.resampling.counts)
        return [f"No ranks and no intervals: the means are over {over}, and at least {least} are needed."]
    notes = [
        "Best in bold, second best underlined. A method shares the mark of a better one if the 95 % interval "
        f"of their paired difference over {over}, as printed, contains zero; differences with such an "
        "interval are in italics. Two methods with different marks need not differ."
    ]
    if any(column.source == TRUTH for column in columns):
        notes.append("nearer: cases in which the method is nearer to the true pose than the reference.")
    return notes


def legend(columns: Sequence[Column]) -> str:
    """Return the definitions of the columns in one note, and which numbers are better."""
    end = "Lower is better"
    if not any(column.ranked or column in TRANSFER_COLUMNS for column in columns):
        end = "The pose itself changes these measures; without ground truth its part is unknown"
    elif any(column.source == SUCCESS for column in columns):
        end += ", except for success"
    defined = "; ".join(f"{heading}: {text}" for heading, text in definitions(columns))
    return f"{defined}. {end}."


def definitions(columns: Sequence[Column]) -> list[tuple[str, str]]:
    """Return the heading and the definition of each column that has one."""
    defined = DEFINITIONS | {f"metric.{name}": metric.equation for name, metric in METRICS.items()}
    return [(c.heading, defined[c.source]) for c in columns if c.source in defined]


def _method_notes(rows: pd.DataFrame) -> list[str]:
    """Return the notes of the methods' configurations, and the notes on references."""
    facts = rows.reindex(columns=["method.name", "method.note", "method.target"]).replace("", None)
    reference = facts.copy()
    reference["method.note"] = facts["method.target"].map(REFERENCES)
    notes = pd.concat([facts, reference])[["method.name", "method.note"]].dropna().drop_duplicates()
    pairs = sorted(notes.to_numpy().tolist(), key=lambda pair: (method_order(pair[0]), pair[1]))
    return [f"{name}: {note}" for name, note in pairs]

"""The sentences under a table: which version, cases and methods its numbers are of, and what is missing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pandas as pd

from eval.metrics import METRICS
from eval.publish.columns import REFERENCES, SUCCESS, Column, begun, reference_rows
from eval.publish.comparison import Comparison
from eval.rows.frame import distinct, method_names, method_order, numbers
from eval.rows.splits import HELD_OUT, TUNING
from eval.rows.store import VALID
from sshade.errors import InputError

#: What the half that cases are of means.
HALF_NOTES = {
    HELD_OUT: "Held-out cases: no constant of a method was chosen on them.",
    TUNING: "Tuning cases: constants of methods were chosen on them.",
}

#: Under a table of poses rebuilt from samples: what the paper's figures are, and what became of them.
REBUILT_NOTE = (
    "The paper gives d_H 5.66e-3 and d_C 3.76e-8 for triangle frames on TOSCA's classes without wolf and "
    "gorilla (6000 samples, 10 samplings). By the definitions below, 36 poses of TOSCA's cat, centaur, "
    "david, dog and horse came out at 1.04e-2 and 3.4e-7 with these frames, at 8.2e-3 and 1.2e-7 with "
    "blended_affine: the paper's figures were not reproduced. Errors of other poses do not compare."
)

#: Under one of edited shapes.
TRANSFERRED_NOTE = (
    "The paper shows pictures of pose transfers and gives their time, about 2 s a mesh, but no errors."
)

#: The edit of a transfer that has none.
UNEDITED = "none"

#: Most names that a note lists, and most characters of a reason.
LISTED, REASON = 4, 160

#: What tells of a row's version: the code's, the metrics', the commit, whether files differed from it.
VERSION = ["env.version.code", "env.version.metrics", "env.commit", "env.modified"]


def shortened(names: Iterable[str]) -> str:
    """Names in a row, the first :data:`LISTED` of them and how many more there are."""
    names = list(names)
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more


def version_notes(rows: pd.DataFrame, *, mixed: bool) -> list[str]:
    """The note that names the version of the code that rows come from, or a warning with all of them.

    Rows that name no version have their commit for one.

    Raises
    ------
    InputError
        When there are several and they are not to be `mixed`.
    """
    made = begun(rows).reindex(columns=["method.name", *VERSION])
    made = made.where(made.notna(), "")
    code, metrics, commit, modified = (made[column].astype(str) for column in VERSION)
    identity = code.where(code != "", commit + modified) + " " + metrics
    # Each method has a version of its own, which covers the modules that it uses.
    line = made["method.name"].where(code != "", "")
    if metrics.nunique() < 2 and not (identity.groupby(line).nunique() > 1).any():
        unknown = "" if code.all() else "Warning: the rows name no version of the code. "
        return [f"{unknown}Code: {_version(made)}."] if len(made) else []
    versions = [own for _, own in made.groupby(identity, sort=False)]
    named = [
        f"{_version(own)}: {len(own)} row{'s' * (len(own) > 1)} of {shortened(method_names(own))}"
        for own in versions
    ]
    differing = f"{len(versions)} versions of the code, whose numbers need not compare"
    said = f"rows of {differing} ({'; '.join(named)})"
    if not mixed:
        again = "measure" if code.groupby(line).nunique().max() == 1 and code.all() else "run"
        by = " with `sshade-eval remeasure`" if again == "measure" else ""
        raise InputError(f"{said}: {again} the older ones again{by}, or print all of them with --mixed")
    return [f"Warning: {said}."]


def _version(rows: pd.DataFrame) -> str:
    """The version of rows in words."""
    facts = {column: shortened(str(value)[:8] for value in distinct(rows, column)) for column in VERSION[:3]}
    code, metrics, commit = facts.values()
    modified = distinct(rows, "env.modified")
    tree = "modified tree" if True in modified else "clean tree" if modified else "tree not known"
    of_metrics = f", metrics {metrics}" if metrics else ""
    return f"version {code or 'unknown'}{of_metrics}, commit {commit or 'unknown'}, {tree}"


def case_notes(rows: pd.DataFrame, comparison: Comparison, *, half: str | None) -> list[str]:
    """Which cases the means are over, what is missing, method by method, and what seeds there are."""
    cases, common = len(comparison.cases), len(comparison.common)
    sizes = numbers(rows, "task.vertices").dropna().astype(int)
    size = " to ".join(f"{n:,}" for n in sorted({sizes.min(), sizes.max()})) if len(sizes) else "unknown"
    over = "all of them"
    if common < cases:
        over = f"{common} of {cases}, those that every method compared has a result for"
    notes = [f"{cases} case{'s' * (cases > 1)} of {size} vertices; means over {over}."]
    notes += [HALF_NOTES[half]] if half else []
    few = comparison.finished.drop(index={*comparison.compared, *rows["method.name"][reference_rows(rows)]})
    few = [f"{name} ({count} of {cases})" for name, count in few[few > 0].items()]
    if few:
        reason = "as with them under half of the cases would be common to all"
        notes.append(f"Without means and ranks, {reason}: {', '.join(few)}.")
    planned = rows.groupby("method.name")["task.name"].nunique()
    notes += [f"{name}: planned on {n} of {cases} cases." for name, n in planned[planned < cases].items()]
    notes += _lost(rows)
    seeds = rows.groupby("method.name")["seed"].nunique()
    if seeds.max() > 1:
        several = "; ".join(f"{count} of {shortened(own.index)}" for count, own in seeds.groupby(seeds))
        notes.append(
            f"Seeds: {several}. The value of a case is the mean over its seeds; ± is the standard deviation "
            "over seeds of the mean over the cases."
        )
    return notes


def _lost(rows: pd.DataFrame) -> list[str]:
    """What has no result: how many runs of each method, the most frequent reason, and the cases."""
    notes = []
    lost = rows[~rows["status"].isin(VALID)]
    for (status, name), own in lost.groupby(["status", "method.name"]):
        reasons = own["reason"].fillna("").value_counts()
        reason = reasons.index[0] if len(reasons.index[0]) <= REASON else f"{reasons.index[0][:REASON]}..."
        reason += " and other reasons" * (len(reasons) > 1)
        every = len(own) == (rows["method.name"] == name).sum()
        where = "every case" if every else shortened(sorted(own["task.name"].unique()))
        notes.append(f"{name}: {len(own)} {status} ({reason}): {where}.")
    return notes


def common_notes(rows: pd.DataFrame, *, columns: Sequence[Column]) -> list[str]:
    """The dataset's note, machine, the methods' own notes and legend."""
    notes = [f"{note}." for note in distinct(rows, "task.meta.note")]
    notes += [f"Machine: {'; '.join(distinct(rows, 'env.machine'))}."]
    notes += _method_notes(rows)
    posed_by = distinct(rows, "task.meta.posed_by")
    notes += [f"The poses come from {', '.join(posed_by)}."] if posed_by else []
    if edits := distinct(rows, "task.meta.edit"):
        notes.append(REBUILT_NOTE if edits == [UNEDITED] else TRANSFERRED_NOTE)
    marks = "Best in bold, second best underlined."
    if any(column.source == "iterations" for column in columns):
        marks += " In brackets after the iterations: runs that converged; the others stopped at the cutoff."
    metrics = {f"metric.{name}": metric.equation for name, metric in METRICS.items()}
    said = {column.heading: column.legend or metrics.get(column.source) for column in columns}
    legend = "; ".join(f"{heading}: {text}" for heading, text in said.items() if text)
    ranked = any(column.ranked for column in columns)
    better = "Lower is better" + ", but for success" * any(column.source == SUCCESS for column in columns)
    end = better if ranked else "The pose changes these by itself, and no truth says by how much"
    return [*notes, marks, f"{legend}. {end}."]


def _method_notes(rows: pd.DataFrame) -> list[str]:
    """The notes of methods' configurations, and those on references."""
    facts = rows.reindex(columns=["method.name", "method.note", "method.target"])
    own = facts[["method.name", "method.note"]].replace("", None)
    reference = facts.assign(**{"method.note": facts["method.target"].map(REFERENCES)})
    notes = pd.concat([own, reference[own.columns]]).dropna().drop_duplicates()
    pairs = sorted(notes.to_numpy().tolist(), key=lambda pair: (method_order(pair[0]), pair[1]))
    return [f"{name}: {note}" for name, note in pairs]

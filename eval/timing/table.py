"""Tables of times: ``sshade-eval timings [NAME ...]`` from the rows of ``sshade-eval bench``.

A line holds the times of a method on a case: the median of the accepted repeats, their minimum and maximum,
stages, cores used, iterations, and the ratio to the time of --reference. With --publish, rows and tables go
to ``results``; the rows must come from a clean checkout.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any, NamedTuple

import pandas as pd

from eval.publish.markdown import markdown_table
from eval.rows.files import PUBLISHED, TIMING, copy_file, rows_file, write_text
from eval.rows.frame import distinct, numbers, read_csv
from eval.timing.drag import STEPS, TOLERANCE
from eval.timing.scaling import FIT_FROM, slopes
from eval.timing.turns import DRAG, LONG, SCALING, WHOLE
from sshade.core.errors import InputError
from sshade.method.deformer import SETTLED

#: Default method of the column "times faster".
REFERENCE = "elastic"
#: Columns ``env.*`` with numbers of threads.
THREADS = ("numba_threads", "omp_num_threads", "openblas_num_threads", "mkl_num_threads")


class TimeTable(NamedTuple):
    """A table of times.

    Attributes
    ----------
    title : str
    lines : DataFrame
        One line per method and case. ``seconds.*`` are medians, except ``seconds.min`` and ``seconds.max``.
    notes : list of str
    """

    title: str
    lines: pd.DataFrame
    notes: list[str]


def _seconds(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


_count = "{:,.0f}".format
_percent = "{:.2g}".format

#: Column -> heading and format in Markdown, in order. Other stages follow in one column.
_COLUMNS: dict[str, tuple[str, Callable[[Any], str]]] = {
    "method": ("method", str),
    "case": ("case", str),
    "vertices": ("vertices", _count),
    "seconds.total": ("median (s)", _seconds),
    "seconds.step": ("median step (s)", _seconds),
    "seconds.min": ("min", _seconds),
    "seconds.max": ("max", _seconds),
    "repeats": ("repeats", _count),
    "speed_up": ("times faster", _seconds),
    "seconds.method": ("method alone (s)", _seconds),
    "seconds.precompute": ("precomputation (s)", _seconds),
    "seconds.solve": ("solve (s)", _seconds),
    "seconds.bind": ("bind (s)", _seconds),
    "seconds.first": ("first solve (s)", _seconds),
    "seconds.step_95": ("step, 95th percentile (s)", _seconds),
    "seconds.step_solve": ("step: solve (s)", _seconds),
    "seconds.step_carry": ("step: carry (s)", _seconds),
    "seconds.step_output": ("step: output (s)", _seconds),
    "seconds.settle": ("settle (s)", _seconds),
    "seconds.rebind": ("new handles (s)", _seconds),
    "drag.first": ("first solve to minimum (%)", _percent),
    "drag.last": ("last step to first solve (%)", _percent),
    "drag.settled": ("settled to minimum (%)", _percent),
    "drag.return": ("there and back (%)", _percent),
    "iterations": ("iterations", _count),
    "extrapolated": ("extrapolated", str),
    "cores_used": ("cores used", "{:.2f}".format),
    "peak_mib": ("peak (MiB)", _count),
    "bytes_per_vertex": ("bytes a vertex", _count),
    "stages": ("other stages (s)", str),
}


def make_time_table(rows: pd.DataFrame, *, title: str, reference: str | None = None) -> TimeTable:
    """Make a table from the rows of one file.

    Parameters
    ----------
    rows : DataFrame
    title : str
    reference : str, optional
        Method that the others are compared with, case by case; by default :data:`REFERENCE` if it has rows.

    Raises
    ------
    InputError
        If rows come from several machines or versions, a method has rows of different parameters, or the
        reference has no rows.
    """
    _check(rows)
    if reference is not None and reference not in set(rows["method.name"]):
        raise InputError(f"{title} has no method {reference!r} to compare with")
    kept = rows[rows["kept"].eq(True)]
    case = ["task.name", "task.checksum", "method.name"]
    lines = pd.DataFrame([_line(own) for _, own in kept.groupby(case, sort=False)])
    # Each line is compared with the line of the same work in this table.
    work = lines["checksum"] + lines["case"]  # two cases may have equal arrays
    base = lines["method"] == (reference or REFERENCE)
    if base.any() and "seconds.total" in lines:
        times = lines.assign(work=work)[base].set_index("work")["seconds.total"]
        lines["speed_up"] = work.map(times) / lines["seconds.total"]
    return TimeTable(title, lines, _notes(rows, lines, reference or REFERENCE))


def _check(rows: pd.DataFrame) -> None:
    """Raise InputError unless the times of the rows can be compared."""
    if not {"kept", "kind"} <= set(rows) or not rows["kept"].eq(True).any():
        raise InputError("the rows hold no times; `sshade-eval bench` makes rows of times")
    same = {"env.machine": "machines", "env.machine_id": "machines"}
    same |= {c: f"versions of {c.removeprefix('env.version.')}" for c in rows if c.startswith("env.version.")}
    for column, what in same.items():
        if len(found := distinct(rows, column)) > 1:
            raise InputError(f"times of {len(found)} {what} ({'; '.join(found)}) do not compare")
    hashes = rows.groupby("method.name")["method.hash"].nunique()
    if hashes.max() > 1:
        raise InputError(f"method {hashes.idxmax()!r} has rows of different parameters: give each a label")


def _line(repeats: pd.DataFrame) -> dict[str, Any]:
    """Return the line of a method and case."""
    first = repeats.iloc[0]
    headline = "seconds.step" if first["kind"] == DRAG else "seconds.total"
    left_out = {"seconds.repeat", "seconds.total"} - {headline}
    stages = [name for name in repeats if name.startswith("seconds.") and name not in left_out]
    measured, cutoff = numbers(repeats, headline), numbers(repeats, "extrapolated_to").iloc[0]
    iterations = numbers(repeats, "iterations").median()
    peak = numbers(repeats, "peak_mib").max()
    line = {
        "kind": first["kind"],
        "method": first["method.name"],
        "case": first["task.name"],
        "checksum": first["task.checksum"],
        "vertices": first["task.vertices"],
        "repeats": len(repeats),
        **{name: numbers(repeats, name).median() for name in stages},
        "seconds.min": measured.min(),
        "seconds.max": measured.max(),
        "cores_used": numbers(repeats, "env.cores_used").median(),
        "iterations": iterations,
        "extrapolated": None,
        **{name: numbers(repeats, name).max() for name in repeats if name.startswith("drag.")},
        "peak_mib": peak,
        "bytes_per_vertex": peak * 2**20 / first["task.vertices"] if first["kind"] == SCALING else None,
    }
    if pd.notna(cutoff):
        line |= {"iterations": cutoff, "extrapolated": f"from {len(repeats)} x {iterations:.0f} iterations"}
    return line


def _notes(rows: pd.DataFrame, lines: pd.DataFrame, reference: str) -> list[str]:
    """Return the notes below a table."""
    machine_id = "".join(f" ({identity})" for identity in distinct(rows, "env.machine_id"))
    tree = ", a modified tree" if rows["env.modified"].iloc[0] is True else ""
    commits = ", ".join(commit[:10] for commit in distinct(rows, "env.commit")) or "unknown"
    days = dict.fromkeys((rows["date"].min()[:10], rows["date"].max()[:10]))
    counts = {name: distinct(rows, f"env.{name}") for name in THREADS}
    threads = ", ".join(f"{name} {', '.join(map(str, own))}" for name, own in counts.items() if own)
    kept = rows["kept"].eq(True)
    reasons = "; ".join(distinct(rows[~kept], "reason"))
    left_out = "compilation" if rows["kind"].eq(WHOLE).all() else "reading of files and compilation"
    notes = [
        f"Machine: {distinct(rows, 'env.machine')[0]}{machine_id}; {threads}.",
        f"Code {distinct(rows, 'env.version.code')[0]} (commit {commits}{tree}), {' to '.join(days)}.",
        f"Methods took turns, after a warm-up; times do not include {left_out}. Other processes used at most "
        f"{numbers(rows[kept], 'other_cores').max():.1%} of the machine's cores during a repeat; "
        f"rejected repeats: {sum(~kept)}{f' ({reasons})' if reasons else ''}.",
    ]
    once = rows[kept].drop_duplicates(["method.name", "task.name", "task.checksum"], keep=False)
    if (numbers(once, "seconds.repeat") > LONG).any():
        notes.append(f"A call of more than {LONG:g} s ran once, before the turns and without a warm-up.")
    if "speed_up" in lines:
        notes.append(
            f"Times faster: median time of {reference} on the same case / median time of the method."
        )
    if lines["extrapolated"].notna().any():
        notes.append("Extrapolated: time before the iterations + iterations x time of an iteration.")
    if "seconds.step" in lines:
        notes.append(
            f"Step: a drag from rest to the targets has {STEPS} steps, each to a residual of {TOLERANCE:g}. "
            "First solve: from rest to the targets at once. Settle: from the last step to the minimum, at "
            f"{SETTLED:g} of the method's tolerance. New handles: a group is removed or added. Distances are "
            "of the farthest vertex, in % of the bounding-box diagonal; there and back: from the solution at "
            "rest to the end of the way back."
        )
    if "seconds.remesh" in lines:
        notes.append("Stages of samplings that run in parallel are summed.")
    if lines["kind"].eq(SCALING).all():
        fit = f"of log time against log vertices, from {FIT_FROM:,} vertices on"
        notes += [f"{method}: slope {slope:.2f} {fit}." for method, slope in slopes(lines).items()]
    return notes


def cells(lines: pd.DataFrame) -> tuple[list[str], list[list[str]]]:
    """Return the headings of the columns that have a number, and the texts of the lines."""
    lines = lines.copy()
    stages = [name for name in lines if name.startswith("seconds.") and name not in _COLUMNS]
    lines["stages"] = [
        ", ".join(f"{s.removeprefix('seconds.')} {_seconds(line[s])}" for s in stages if pd.notna(line[s]))
        for _, line in lines.iterrows()
    ]
    used = [name for name in _COLUMNS if name in lines and lines[name].replace("", None).notna().any()]
    body = [
        ["" if pd.isna(value) else _COLUMNS[name][1](value) for name, value in zip(used, values, strict=True)]
        for values in lines[used].itertuples(index=False)
    ]
    return [_COLUMNS[name][0] for name in used], body


def to_markdown(table: TimeTable) -> str:
    """Return the table and its notes in Markdown."""
    headings, body = cells(table.lines)
    left = [heading for heading, form in _COLUMNS.values() if form is str]
    notes = [f"- {note}" for note in table.notes]
    lines = [f"### {table.title}", "", markdown_table(headings, body, left=left), "", *notes]
    return "\n".join(lines) + "\n"


def to_csv(table: TimeTable) -> str:
    """Return the numbers with six digits."""
    lines = table.lines.dropna(axis="columns", how="all")
    return lines.to_csv(index=False, float_format="%.6g", lineterminator="\n")


def require_free(name: str) -> None:
    """Raise InputError if an experiment has the name: the tables of times would replace its tables."""
    path = rows_file(name)
    if path.is_file():
        raise InputError(f"{name} is the name of an experiment in {path.parent}; give another --name")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("names", nargs="*", metavar="NAME", help="a CSV in out/timing (default: all)")
    text = f"method that `times faster` compares with (default: {REFERENCE}, if it has rows)"
    parser.add_argument("--reference", metavar="METHOD", help=text)
    parser.add_argument("--publish", action="store_true", help="write to results instead of out")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    files = [rows_file(name, TIMING) for name in options.names] or sorted(TIMING.glob("*.csv"))
    missing = [path for path in files or [TIMING] if not path.is_file()]
    if missing:
        raise InputError(f"{missing[0]}: no rows of times there; `sshade-eval bench` makes them")
    root = PUBLISHED if options.publish else TIMING.parent
    if options.publish and not root.is_dir():
        raise InputError(f"there is no {root} here; publish from the project's own folder")
    tables = {}
    for path in files:
        rows = read_csv(path)
        require_free(path.stem)
        tables[path] = make_time_table(rows, title=path.stem, reference=options.reference)
        if options.publish and (distinct(rows, "env.modified") != [False] or not all(rows["env.commit"])):
            raise InputError(
                f"{path}: some rows come from a checkout with changes that are not committed; commit, and "
                "run `sshade-eval bench` again"
            )
    for path, table in tables.items():
        for suffix, text_of in ((".csv", to_csv), (".md", to_markdown)):
            write_text(root / "tables" / f"{table.title}{suffix}", text_of(table))
        if options.publish and path.resolve() != (root / "timing" / path.name).resolve():
            copy_file(path, root / "timing" / path.name)
        print(f"From {path}:\n\n{to_markdown(table)}")  # noqa: T201
    return 0

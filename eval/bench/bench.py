"""Measure times: ``sshade-eval bench KIND --methods ... --cases ...`` writes one row per repeat, and a table.

Methods take turns (A B C A B C ...). A repeat counts if other processes use at most 5 % of the cores.

kinds:
  speed    calls of methods; those of --extrapolate run 10 iterations, from which the full time is estimated
  drag     methods that can be bound: bind, first solve, steps of a drag, the way back
  scaling  subdivided meshes, each in a new process, with the peak of its memory
  whole    `sshade deform` with files and imports; without cases on a tiny mesh

A method or a case is [LABEL=]NAME [KEY=VALUE ...], with NAME in conf/method or conf/dataset. A KEY with a dot
is a setting of the whole configuration, such as solver.start.

  sshade-eval bench speed --methods elastic "paper-1=paper samplings=1" --extrapolate elastic \\
    --cases "defaust root=data/defaust_170k subject=0 pose=1,2" "mesh mesh=body.ply handles=pose.json"
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from eval.bench.cases import TimedCase, TimedMethod
from eval.bench.jobs import time_calls, time_commands, time_drags, time_scaling
from eval.bench.turns import LONG
from eval.publish.columns import markdown_table
from eval.rows.files import TIMING, add_out, write_text
from eval.rows.frame import distinct, numbers, to_frame, write_csv
from eval.rows.store import Row
from eval.run.config import check_root, one_each, read_choice, require_own, resolved, source_of, task_of
from sshade.core.errors import InputError

#: Kinds of times, the column ``kind`` of rows.
SPEED, DRAG, SCALING, WHOLE = "speed", "drag", "scaling", "whole"
#: Column with the ratio of a method's time to the time of a line -> the method.
FACTORS = {"speed_up": "elastic", "speed_up_accelerated": "accelerated_elastic"}
#: Columns that identify a line.
LINE = ["task.name", "task.checksum", "method.name"]
#: Columns ``env.*`` with numbers of threads.
THREADS = ("numba_threads", "omp_num_threads", "openblas_num_threads", "mkl_num_threads")


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
    "speed_up_accelerated": ("times faster than accelerated", _seconds),
    "cores_used": ("cores used", "{:.2f}".format),
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
    "truth": ("truth (%)", "{:.2f}".format),
    "peak_mib": ("peak (MiB)", _count),
    "bytes_per_vertex": ("bytes a vertex", _count),
    "stages": ("other stages (s)", str),
}
#: Function that times the methods of a kind.
KINDS: dict[str, Callable[..., list[Row]]] = {
    SPEED: time_calls,
    DRAG: time_drags,
    SCALING: time_scaling,
    WHOLE: time_commands,
}
#: Numbers of vertices of the kind scaling by default, and largest number of subdivisions of a case.
SIZES = (10_000, 30_000, 100_000, 300_000, 450_000, 1_000_000, 3_000_000, 5_000_000)
DEEPEST = 5


def read_methods(texts: Iterable[str], *, extrapolate: Sequence[str]) -> list[TimedMethod]:
    """Resolve the choices of methods.

    Raises
    ------
    InputError
        If a choice cannot be resolved, two methods have the same label, or none has a label of `extrapolate`.
    """
    choices = [read_choice(text) for text in texts]
    labels = [choice.label for choice in choices]
    if twice := [label for label in labels if labels.count(label) > 1]:
        raise InputError(f"two methods are named {twice[0]!r}; name one of them LABEL={twice[0]}")
    for choice in choices:
        require_own(choice.label, choice.name)
    if unknown := [label for label in extrapolate if label not in labels]:
        raise InputError(f"--extrapolate names {unknown[0]}, which is none of the methods")
    return [TimedMethod(c.label, resolved("method", c), c.label in extrapolate) for c in choices]


def read_cases(texts: Iterable[str], *, sizes: Sequence[int]) -> list[TimedCase]:
    """Resolve the choices of datasets. `sizes` asks for subdivisions with about these numbers of vertices.

    Raises
    ------
    InputError
        If a choice cannot be resolved, or the dataset is missing.
    """
    sources = []
    for choice in [one for text in texts for one in one_each(read_choice(text))]:
        config = resolved("dataset", choice)
        check_root(config)
        sources.append(source_of(config))
    if not sizes:
        return [TimedCase(source) for source in sources]
    counts = [task_of(source, truth=False).mesh.n for source in sources]
    levels = [(4**level * n, i, level) for i, n in enumerate(counts) for level in range(DEEPEST + 1)]
    nearest = {min(levels, key=lambda case: abs(np.log(case[0] / size))) for size in sizes}
    return [TimedCase(sources[i], level) for _, i, level in sorted(nearest)]


def time_lines(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the lines of a table: ``seconds.*`` are medians, except ``seconds.min`` and ``seconds.max``."""
    kept = rows[rows["kept"].eq(True)].copy()
    headline = "seconds.step" if kept["kind"].iloc[0] == DRAG else "seconds.total"
    left_out = {"seconds.repeat", "seconds.total"} - {headline}
    stages = [name for name in kept if name.startswith("seconds.") and name not in left_out]
    drags = [name for name in kept if name.startswith("drag.")]
    others = ["iterations", "extrapolated_to", "env.cores_used", "peak_mib", "metric.truth_distance"]
    for name in (*stages, *drags, *others):
        kept[name] = numbers(kept, name)
    groups = kept.groupby(LINE, sort=False)
    lines = groups[["kind", "method.name", "task.name", "task.checksum", "task.vertices"]].first()
    lines.columns = ["kind", "method", "case", "checksum", "vertices"]
    lines["repeats"] = groups.size()
    lines[stages] = groups[stages].median()
    lines["seconds.min"], lines["seconds.max"] = groups[headline].min(), groups[headline].max()
    lines["cores_used"] = groups["env.cores_used"].median()
    lines["iterations"], limit = groups["iterations"].median(), groups["extrapolated_to"].first()
    texts = lines.apply(lambda line: f"from {line['repeats']} x {line['iterations']:.0f} iterations", axis=1)
    lines["extrapolated"] = texts.where(limit.notna(), None)
    lines["iterations"] = limit.fillna(lines["iterations"])
    lines[drags] = groups[drags].max()
    lines["truth"] = groups["metric.truth_distance"].first()
    lines["peak_mib"] = groups["peak_mib"].max()
    per_vertex = lines["peak_mib"] * 2**20 / lines["vertices"].astype(float)
    lines["bytes_per_vertex"] = per_vertex.where(lines["kind"] == SCALING)
    for column, method in FACTORS.items():
        if method in set(lines["method"]) and "seconds.total" in lines:
            reference = lines.xs(method, level="method.name")["seconds.total"]
            times = reference.reindex(lines.index.droplevel("method.name"))
            lines[column] = times.to_numpy() / lines["seconds.total"]
    return lines.reset_index(drop=True)


def notes(rows: pd.DataFrame) -> list[str]:
    """Return the notes below a table."""
    machine_id = "".join(f" ({identity})" for identity in distinct(rows, "env.machine_id"))
    tree = ", a modified tree" if rows["env.modified"].iloc[0] is True else ""
    commit = "".join(distinct(rows, "env.commit"))[:10] or "unknown"
    days = dict.fromkeys((rows["date"].min()[:10], rows["date"].max()[:10]))
    counts = {name: distinct(rows, f"env.{name}") for name in THREADS}
    threads = ", ".join(f"{name} {', '.join(map(str, own))}" for name, own in counts.items() if own)
    kept = rows["kept"].eq(True)
    reasons = "; ".join(distinct(rows[~kept], "reason"))
    left_out = "compilation" if rows["kind"].eq(WHOLE).all() else "reading of files and compilation"
    found = [
        f"Machine: {distinct(rows, 'env.machine')[0]}{machine_id}; {threads}.",
        f"Commit {commit}{tree}, {' to '.join(days)}.",
        f"Methods took turns, after a warm-up; times do not include {left_out}. Other processes used at most "
        f"{numbers(rows[kept], 'other_cores').max():.1%} of the machine's cores during a repeat; "
        f"rejected repeats: {sum(~kept)}{f' ({reasons})' if reasons else ''}.",
    ]
    if "hair" in rows:
        hair = numbers(rows, "hair").max()
        found.append(f"Each call has new meshes, and targets moved by {hair:g} of the diagonal.")
    if "quality" in rows:
        compared = rows[rows["quality"].notna()].groupby("method.name", sort=False)["quality"].first()
        files = "; ".join(f"{name} {file}" for name, file in compared.items())
        found.append(f"Rows of equal runs, whose measures agree: {files}.")
    once = rows[kept].drop_duplicates(LINE, keep=False)
    if (numbers(once, "seconds.repeat") > LONG).any():
        found.append(f"A call of more than {LONG:g} s ran once, before the turns and without a warm-up.")
    return found


def to_markdown(lines: pd.DataFrame) -> str:
    """Return the columns that have a number as a table in Markdown; other stages follow in one column."""
    stages = [name for name in lines if name.startswith("seconds.") and name not in _COLUMNS]
    texts = [
        ", ".join(f"{s.removeprefix('seconds.')} {_seconds(line[s])}" for s in stages if pd.notna(line[s]))
        for _, line in lines.iterrows()
    ]
    lines = lines.assign(stages=texts)
    used = [name for name in _COLUMNS if name in lines and lines[name].replace("", None).notna().any()]
    body = [
        ["" if pd.isna(value) else _COLUMNS[name][1](value) for name, value in zip(used, values, strict=True)]
        for values in lines[used].itertuples(index=False)
    ]
    left = [heading for heading, form in _COLUMNS.values() if form is str]
    return markdown_table([_COLUMNS[name][0] for name in used], body, left=left)


def write_tables(rows: pd.DataFrame, path: Path) -> str:
    """Write the table of some rows, as CSV with six digits and in Markdown; return the Markdown.

    Parameters
    ----------
    rows : DataFrame
    path : Path
        Of the files, without a suffix; its name is the title.
    """
    lines = time_lines(rows)
    table = [f"### {path.name}", "", to_markdown(lines), "", *(f"- {note}" for note in notes(rows))]
    markdown = "\n".join(table) + "\n"
    csv = lines.dropna(axis="columns", how="all")
    write_text(f"{path}.csv", csv.to_csv(index=False, float_format="%.6g", lineterminator="\n"))
    write_text(f"{path}.md", markdown)
    return markdown


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("kind", choices=KINDS, metavar="KIND", help=argparse.SUPPRESS)
    parser.add_argument("--methods", nargs="+", required=True, metavar="M", help="methods, see above")
    parser.add_argument("--cases", nargs="+", default=(), metavar="C", help="cases, see above")
    parser.add_argument("--sizes", type=int, nargs="+", default=(), metavar="N", help="subdivide to sizes")
    text = "methods whose time is estimated"
    parser.add_argument("--extrapolate", nargs="+", default=(), metavar="M", help=text)
    parser.add_argument("--rounds", type=int, default=3, metavar="R", help="accepted repeats (default: 3)")
    parser.add_argument("--name", help="name of the rows and of the table (default: KIND)")
    add_out(parser, TIMING.parent, "folder of timing and tables")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    kind, name = options.kind, options.name or options.kind
    if not re.fullmatch(r"[\w.+=-]+", name):
        raise InputError(f"--name {name!r} is no name of a file; use letters, digits and _.+=-")
    if min(options.rounds, *options.sizes, 1) < 1:
        raise InputError("--rounds and --sizes take numbers from 1")
    if not options.cases and (kind != WHOLE or options.sizes):
        raise InputError(f"{kind} needs --cases; see `sshade-eval bench --help`")
    if options.extrapolate and kind != SPEED:
        raise InputError(f"{kind} takes no --extrapolate, which is for {SPEED}")
    cases = read_cases(options.cases, sizes=options.sizes or (SIZES if kind == SCALING else ()))
    methods = (
        options.methods if kind == WHOLE else read_methods(options.methods, extrapolate=options.extrapolate)
    )
    rows = to_frame(row | {"kind": kind} for row in KINDS[kind](methods, cases, rounds=options.rounds))
    path = options.out / TIMING.name / f"{name}.csv"
    write_csv(path, rows)
    print(f"{path}: repeats kept {rows['kept'].sum()} of {len(rows)}\n")  # noqa: T201
    print(write_tables(rows, options.out / "tables" / name))  # noqa: T201
    return 0

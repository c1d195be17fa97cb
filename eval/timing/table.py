"""Tables of times: ``sshade-eval timings [NAME ...]`` from the rows that ``sshade-eval bench`` wrote.

A line a method and case: the median of the kept repeats with their minimum and maximum, stages,
cores used, iterations, and how many times faster than --reference it is. Those of subdivided meshes are
drawn, too. With --publish rows, tables and pictures go into ``results``, if the rows come from a clean tree.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from eval.publish.plotting import save
from eval.rows.frame import distinct, numbers, read_csv
from eval.rows.store import PUBLISHED, ROWS
from eval.timing.drag import KIND as DRAG
from eval.timing.drag import STEPS, TOLERANCE
from eval.timing.scaling import FIT_FROM, draw_scaling, is_scaling, slopes
from eval.timing.scaling import KIND as SCALING
from eval.timing.whole import KIND as WHOLE
from sshade.errors import InputError
from sshade.io.files import make_folder, replacing
from sshade.pipeline.deformer import SETTLED

#: Where the rows of times lie: one CSV a name.
TIMING = Path("out/timing")
#: What others are compared with where it is there.
REFERENCE = "elastic"
#: Settings of the number of threads.
THREADS = ("numba_threads", "omp_num_threads", "openblas_num_threads", "mkl_num_threads")


class TimeTable(NamedTuple):
    """A table of times.

    Attributes
    ----------
    title : str
    lines : DataFrame
        A line a method and case. ``seconds.*`` are medians, but ``seconds.min`` and ``seconds.max``.
    notes : list of str
    """

    title: str
    lines: pd.DataFrame
    notes: list[str]


def _seconds(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _count(value: float) -> str:
    return f"{value:,.0f}"


#: Headings of Markdown and their formats, in this order; other stages follow.
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
    "seconds.method": ("of it the method (s)", _seconds),
    "seconds.precompute": ("precomputation (s)", _seconds),
    "seconds.solve": ("solve (s)", _seconds),
    "seconds.bind": ("bind (s)", _seconds),
    "seconds.first": ("first solve (s)", _seconds),
    "seconds.step_95": ("step, 95th percentile (s)", _seconds),
    "seconds.step_solve": ("of it solve (s)", _seconds),
    "seconds.step_carry": ("carry (s)", _seconds),
    "seconds.step_output": ("output (s)", _seconds),
    "seconds.settle": ("settle (s)", _seconds),
    "seconds.rebind": ("other handles (s)", _seconds),
    "drag.first": ("first solve from its minimum (%)", "{:.2g}".format),
    "drag.last": ("last step from first solve (%)", "{:.2g}".format),
    "drag.settled": ("settled from that minimum (%)", "{:.2g}".format),
    "drag.return": ("there and back (%)", "{:.2g}".format),
    "iterations": ("iterations", _count),
    "extrapolated": ("extrapolated", str),
    "cores_used": ("cores used", "{:.2f}".format),
    "peak_mib": ("peak (MiB)", _count),
    "bytes_per_vertex": ("bytes a vertex", _count),
    "stages": ("other stages (s)", str),
}


def make_time_table(rows: pd.DataFrame, *, title: str, reference: str | None = None) -> TimeTable:
    """Gather the rows of one file into a table.

    Parameters
    ----------
    rows : DataFrame
    title : str
    reference : str, optional
        The method that others are compared with, on the same case; by default
        :data:`REFERENCE` where it is there.

    Raises
    ------
    InputError
        When rows come from several machines or versions, a method has rows of different
        parameters, or the reference is not there.
    """
    _check(rows)
    if reference is not None and reference not in set(rows["method.name"]):
        raise InputError(f"{title} has no method {reference!r} to compare with")
    kept = rows[rows["kept"].eq(True)]
    case = ["task.name", "task.checksum", "method.name"]
    lines = pd.DataFrame([_line(own) for _, own in kept.groupby(case, sort=False)])
    base = lines[lines["method"] == (reference or REFERENCE)]
    if len(base) and "seconds.total" in lines:
        base = base.set_index("checksum")["seconds.total"]
        lines["speed_up"] = lines["checksum"].map(base) / lines["seconds.total"]
    return TimeTable(title, lines, _notes(rows, lines, reference or REFERENCE))


def _check(rows: pd.DataFrame) -> None:
    """Raise InputError unless the times of the rows compare."""
    if not {"kept", "kind"} <= set(rows) or not rows["kept"].eq(True).any():
        raise InputError("these are no rows of times; `sshade-eval bench` makes them")
    for fact in ("env.machine", "env.machine_id"):
        if len(found := distinct(rows, fact)) > 1:
            raise InputError(
                f"the rows come from {len(found)} machines ({'; '.join(found)}), whose times do not compare"
            )
    for fact in rows.columns[rows.columns.str.startswith("env.version.")]:
        if len(found := distinct(rows, fact)) > 1:
            what = fact.removeprefix("env.version.")
            raise InputError(f"the rows come from {len(found)} versions of {what} ({'; '.join(found)})")
    hashes = rows.groupby("method.name")["method.hash"].nunique()
    if hashes.max() > 1:
        raise InputError(f"method {hashes.idxmax()!r} has rows of different parameters: give each a label")


def _line(own: pd.DataFrame) -> dict[str, Any]:
    """The line of a method and case."""
    first = own.iloc[0]
    headline = "seconds.step" if first["kind"] == DRAG else "seconds.total"
    left_out = {"seconds.repeat", "seconds.total"} - {headline}
    stages = [name for name in own if name.startswith("seconds.") and name not in left_out]
    measured, cutoff = numbers(own, headline), numbers(own, "extrapolated_to").iloc[0]
    iterations = numbers(own, "iterations").median()
    peak = numbers(own, "peak_mib").max()
    line = {
        "kind": first["kind"],
        "method": first["method.name"],
        "case": first["task.name"],
        "checksum": first["task.checksum"],
        "vertices": first["task.vertices"],
        "repeats": len(own),
        **{name: numbers(own, name).median() for name in stages},
        "seconds.min": measured.min(),
        "seconds.max": measured.max(),
        "cores_used": numbers(own, "env.cores_used").median(),
        "iterations": iterations,
        "extrapolated": None,
        **{name: numbers(own, name).max() for name in own if name.startswith("drag.")},
        "peak_mib": peak,
        "bytes_per_vertex": peak * 2**20 / first["task.vertices"] if first["kind"] == SCALING else None,
    }
    if pd.notna(cutoff):
        line |= {"iterations": cutoff, "extrapolated": f"from {len(own)} x {iterations:.0f} iterations"}
    return line


def _notes(rows: pd.DataFrame, lines: pd.DataFrame, reference: str) -> list[str]:
    identity = distinct(rows, "env.machine_id")
    tree = {True: ", a modified tree", False: ""}.get(rows["env.modified"].iloc[0], "")
    commits = ", ".join(commit[:10] for commit in distinct(rows, "env.commit")) or "unknown"
    days = sorted({date[:10] for date in rows["date"]})
    given = {name: distinct(rows, f"env.{name}") for name in THREADS}
    threads = ", ".join(f"{name} {', '.join(map(str, own))}" for name, own in given.items() if own)
    notes = [
        f"Machine: {distinct(rows, 'env.machine')[0]}{f' ({identity[0]})' if identity else ''}; {threads}.",
        f"Code {distinct(rows, 'env.version.code')[0]} (commit {commits}{tree}), {' to '.join(days)}.",
    ]
    lost = rows[~rows["kept"].eq(True)]
    most = numbers(rows[rows["kept"].eq(True)], "other_cores").max()
    told = f" ({'; '.join(distinct(lost, 'reason'))})" if len(lost) else ""
    left_out = "compilation" if rows["kind"].eq(WHOLE).all() else "reading of files and compilation"
    notes.append(
        f"Methods took turns, after a warm-up, with {left_out} outside of the clock. "
        f"Other processes used {most:.1%} of the machine's cores at most during a repeat; "
        f"repeats thrown away: {len(lost)}{told}."
    )
    if "speed_up" in lines:
        notes.append(f"Times faster: the median of {reference} on the same case over that of the method.")
    if lines["extrapolated"].notna().any():
        notes.append("Extrapolated: time before the iterations, and that of an iteration for each of them.")
    if "seconds.step" in lines:
        notes.append(
            f"Step: one of a drag of {STEPS} from rest to the targets, each to a residual of {TOLERANCE:g}; "
            "first solve: from rest to the targets at once. Settle: from the last step to the minimum; other "
            "handles: a group less, or again. Distances are the farthest vertex's, of the bounding-box "
            f"diagonal; a minimum is at {SETTLED:g} of the method's tolerance. There and back: after the "
            "way back from before."
        )
    if "seconds.remesh" in lines:
        notes.append("Stages of samplings that run beside each other are added up.")
    if not is_scaling(lines):
        return notes
    return notes + [
        f"{method}: slope {slope:.2f} of log time against log vertices from {FIT_FROM:,} on."
        for method, slope in slopes(lines).items()
    ]


def to_markdown(table: TimeTable) -> str:
    """The table with the columns that have a number, and the notes under it."""
    lines = table.lines.copy()
    stages = [name for name in lines if name.startswith("seconds.") and name not in _COLUMNS]
    lines["stages"] = [
        ", ".join(f"{s.removeprefix('seconds.')} {_seconds(line[s])}" for s in stages if pd.notna(line[s]))
        for _, line in lines.iterrows()
    ]
    used = [name for name in _COLUMNS if name in lines and lines[name].replace("", None).notna().any()]
    texts = [lines[name].map(lambda value, name=name: _cell(name, value)) for name in used]
    body = [f"| {' | '.join(cells)} |" for cells in zip(*texts, strict=True)]
    sides = ["---" if _COLUMNS[name][1] is str else "---:" for name in used]
    head = [f"| {' | '.join(_COLUMNS[name][0] for name in used)} |", f"| {' | '.join(sides)} |"]
    notes = [f"- {note}" for note in table.notes]
    return "\n".join([f"### {table.title}", "", *head, *body, "", *notes]) + "\n"


def _cell(name: str, value: Any) -> str:
    return "" if pd.isna(value) else _COLUMNS[name][1](value)


def to_csv(table: TimeTable) -> str:
    """Numbers to six digits."""
    lines = table.lines.dropna(axis="columns", how="all")
    return lines.to_csv(index=False, float_format="%.6g", lineterminator="\n")


def timing_file(name: str) -> Path:
    """The CSV meant by a path, or by a name: in out/timing, or else in results/timing."""
    if Path(name).suffix == ".csv":
        return Path(name)
    files = [folder / f"{name}.csv" for folder in (TIMING, PUBLISHED / "timing")]
    return next((path for path in files if path.is_file()), files[0])


def require_free(name: str) -> None:
    """Raise InputError where an experiment has a name, whose tables those of times would replace."""
    for folder in (ROWS, PUBLISHED / "rows"):
        if (folder / f"{name}.csv").exists():
            raise InputError(
                f"{name} is the name of an experiment in {folder}; give the times another --name"
            )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("names", nargs="*", metavar="NAME", help="of a CSV in out/timing (default: all)")
    parser.add_argument("--reference", metavar="METHOD", help=f"default: {REFERENCE}, where it is there")
    parser.add_argument("--publish", action="store_true", help="into results instead of out")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    files = [timing_file(name) for name in options.names] or sorted(TIMING.glob("*.csv"))
    if not files or not all(path.is_file() for path in files):
        where = next((path for path in files if not path.is_file()), TIMING)
        raise InputError(f"{where}: no rows of times there; `sshade-eval bench` makes them")
    tables = {}
    for path in files:
        rows = read_csv(path)
        require_free(path.stem)
        tables[path] = make_time_table(rows, title=path.stem, reference=options.reference)
        if options.publish:
            _require_clean(rows, path)
    root = PUBLISHED if options.publish else TIMING.parent
    if options.publish and not root.is_dir():
        raise InputError(f"there is no {root} here; publish from the project's own folder")
    for path, table in tables.items():
        make_folder(root / "tables")
        for suffix, text_of in ((".csv", to_csv), (".md", to_markdown)):
            with replacing(root / "tables" / f"{table.title}{suffix}") as temporary:
                temporary.write_text(text_of(table))
        if is_scaling(table.lines):
            save(draw_scaling(table.lines), root / "figures" / f"{table.title}.svg")
        if options.publish and path.resolve() != (root / "timing" / path.name).resolve():
            make_folder(root / "timing")
            with replacing(root / "timing" / path.name) as temporary:
                shutil.copyfile(path, temporary)
        print(to_markdown(table))  # noqa: T201
    return 0


def _require_clean(rows: pd.DataFrame, path: Path) -> None:
    """Raise InputError unless a commit holds the code that made the rows."""
    if distinct(rows, "env.modified") != [False] or not all(rows["env.commit"]):
        raise InputError(f"{path}: rows of a modified tree are not published; commit, and time again")

"""Tables from rows: ``sshade-eval tables [ROWS ...]`` writes CSV, Markdown and LaTeX.

A table has one line per method, with means over the cases that all methods have. Its columns are in the order
of the paper's table. A second table holds further measures, a third the differences to a reference method.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from eval.publish.columns import Column, markdown_table
from eval.publish.comparison import RUN
from eval.publish.notes import require_one_version
from eval.publish.paper import paper_tables
from eval.publish.plotting import FIGURES, SUFFIXES
from eval.publish.summary import Table, make_table, ranks
from eval.rows.collect import read_experiments
from eval.rows.files import PUBLISHED, ROWS, ROWS_HELP, add_out, rows_file, write_text, writing
from eval.rows.frame import newest, numbers, read_csv, write_csv
from sshade.core.errors import InputError, counted

#: The project's packages. Methods from all other packages belong to users.
OWN = ("sshade", "baselines", "eval")

#: Heading of the counts of cases in which a method is nearer to the true pose than the reference.
NEARER = "nearer"
#: Key of the mark of a difference whose interval contains zero.
TIE = -1
#: Characters that LaTeX does not print as they are.
_ESCAPES = str.maketrans(
    {c: f"\\{c}" for c in "&%$#_{}"} | {"\\": r"\textbackslash{}", "^": r"\^{}", "~": r"\~{}"}
)


def to_csv(table: Table) -> str:
    """Return numbers with six digits, without marks. If there are parts, a first column names them.

    Columns ``difference of``, ``low of`` and ``high of`` hold the differences and their intervals, and
    ``smaller of`` counts the cases in which a method has a smaller number than the reference.
    """
    tables = {"all": table} | {part.title: part for part in table.parts}
    labels = {c.heading: f"{c.heading} [{c.unit}]" if c.unit else c.heading for c in table.columns}
    spreads = {heading: f"sd of {label}" for heading, label in labels.items()}

    def lines_of(part: Table) -> pd.DataFrame:
        values = [part.means.rename(columns=labels), part.spread.rename(columns=spreads)]
        for heading, found in part.differences.items():
            values.append(found.add_suffix(f" of {labels[heading]}").reindex(part.lines.index))
        texts = [numbers.map("{:.6g}".format, na_action="ignore") for numbers in values]
        about = part.lines[["runs", "valid", "cases", "converged"]]
        return pd.concat([about, *texts], axis="columns")

    lines = pd.concat({name: lines_of(part) for name, part in tables.items()}, names=["part", "method"])
    empty = lines.isna().all()
    lines = lines.drop(columns=[name for name in spreads.values() if empty.get(name, False)])
    lines = lines if table.parts else lines.droplevel("part")
    return lines.to_csv(lineterminator="\n")


def to_markdown(table: Table) -> str:
    """Return all tables, the notes and the parts."""
    marks = {0: "{}", 1: "**{}**", 2: "<u>{}</u>", TIE: "*{}*"}
    out: list[str] = []
    for part in (table, *table.parts):
        for heading, labels, body in printed(part, marks, not_available="n/a"):
            out += [f"{'####' if out else '###'} {heading}", ""]
            out += [markdown_table(labels, body, left=["method"]), ""]
        out += [f"- {note}" for note in part.notes] + [""] * bool(part.notes)
    return "\n".join(out)


def to_latex(table: Table) -> str:
    """Return booktabs tabulars of all tables, with notes as comments."""
    marks = {0: "{}", 1: "\\textbf{{{}}}", 2: "\\underline{{{}}}", TIE: "\\textit{{{}}}"}
    parts = (table, *table.parts)
    notes_of_parts = (f"{part.title}: {note}" for part in table.parts for note in part.notes)
    # A line break in a note would end the comment.
    out = [f"% {' '.join(note.split())}" for note in (*table.notes, *notes_of_parts)]
    for heading, columns in table.views:
        bodies = {
            part.title: cells(part, columns, marks, not_available="--", spread=" $\\pm$ ", escape=_escape)
            for part in parts
        }
        out += _tabular(heading, ["method", "runs"], columns, bodies)
    for part in parts:
        if part.difference_view:
            heading, columns = part.difference_view
            labels = ["method"] if part.nearer is None else ["method", NEARER]
            body = difference_cells(part, columns, marks, escape=_escape)
            out += _tabular(heading, labels, columns, {part.title: body})
    return "\n".join(out) + "\n"


def _tabular(
    heading: str, labels: list[str], columns: Sequence[Column], bodies: Mapping[str, list[list[str]]]
) -> list[str]:
    """Return the lines of a tabular. All bodies but the first have their titles above them."""
    units = {"%": " (\\%)", "deg": " ($^\\circ$)", "": ""}
    labels = [*labels, *(_escape(c.heading) + units[c.unit] for c in columns)]
    out = [f"% {heading}", f"\\begin{{tabular}}{{l{'r' * (len(labels) - 1)}}}", "\\toprule"]
    out += [" & ".join(labels) + " \\\\"]
    for k, (title, body) in enumerate(bodies.items()):
        out.append("\\midrule")
        if k:
            out.append(f"\\multicolumn{{{len(labels)}}}{{l}}{{{_escape(title)}}} \\\\")
        out += [" & ".join(texts) + " \\\\" for texts in body]
    return [*out, "\\bottomrule", "\\end{tabular}"]


FORMATS: dict[str, Callable[[Table], str]] = {"csv": to_csv, "md": to_markdown, "tex": to_latex}


def printed(
    table: Table, marks: Mapping[int, str], **form: Any
) -> Iterator[tuple[str, list[str], list[list[str]]]]:
    """Yield the heading, the labels and the lines of each table: means, and differences if there are any.

    `marks` and `form` go to :func:`cells`.
    """
    for heading, columns in table.views:
        labels = ["method", "runs", *(column.label for column in columns)]
        yield heading, labels, cells(table, columns, marks, **form)
    if table.difference_view:
        heading, columns = table.difference_view
        labels = ["method"] if table.nearer is None else ["method", NEARER]
        body = difference_cells(table, columns, marks, escape=form.get("escape", str))
        yield heading, [*labels, *(column.label for column in columns)], body


def difference_cells(
    table: Table, columns: Sequence[Column], marks: Mapping[int, str], *, escape: Callable[[str], str] = str
) -> list[list[str]]:
    """Return the differences to the reference with their intervals, a line for each other method.

    The count of cases in which the method is nearer to the true pose stands after its name, if there is one.
    """
    body, nearer = [], table.nearer
    for name in table.lines.index[table.lines["competes"]].drop(table.reference):
        of_method = {column: table.differences[column.heading].loc[name] for column in columns}
        texts = [difference_text(column, found, marks[TIE]) for column, found in of_method.items()]
        body.append([escape(name), *([] if nearer is None else [nearer[name]]), *texts])
    return body


def difference_text(column: Column, found: pd.Series, tie: str) -> str:
    """Return a difference with its interval, in the format `tie` if the interval contains zero."""
    if np.isnan(found["difference"]):
        return "-"
    difference, low, high = (column.text(found[end], "+") for end in ("difference", "low", "high"))
    return (tie if found["low"] <= 0 <= found["high"] else "{}").format(f"{difference} [{low}, {high}]")


def cells(
    table: Table,
    columns: Sequence[Column],
    marks: Mapping[int, str],
    *,
    not_available: str,
    spread: str = " ± ",
    escape: Callable[[str], str] = str,
) -> list[list[str]]:
    """Return the texts of a table, line by line.

    Parameters
    ----------
    table : Table
    columns : sequence of Column
    marks : dict
        Format of a number by its rank; 0 for no rank, :data:`TIE` for a difference that may be zero.
    not_available : str
        Text of a missing number.
    spread : str
        Text between a mean and its standard deviation.
    escape : callable
        Escapes a method's name.
    """
    own = {column.heading: column for column in table.columns}  # a part may have other formats
    rank = {c.heading: ranks(table, c.heading) if c.heading in own else {} for c in columns}
    body = []
    for method, line in table.lines.iterrows():
        texts = [escape(method), f"{line.runs}" if line.valid == line.runs else f"{line.valid}/{line.runs}"]
        for heading in (column.heading for column in columns):
            mean = table.means.at[method, heading] if heading in own else np.nan
            if np.isnan(mean):
                texts.append(not_available if line.cases else line.outcome)
                continue
            text = marks[rank[heading].get(method, 0)].format(own[heading].text(mean))
            deviation = table.spread.get(heading, {}).get(method, np.nan)
            if own[heading].ranked and not np.isnan(deviation):
                text += spread + own[heading].text(deviation)
            if own[heading].source == "iterations" and line.converged != "-":
                text += f" ({line.converged})"
            texts.append(text)
        body.append(texts)
    return body


def _escape(text: str) -> str:
    return text.translate(_ESCAPES)


def write_tables(tables: Iterable[Table], folder: Path) -> None:
    """Write tables in every format, as ``folder/<title>.<suffix>``."""
    for table in tables:
        for suffix, text_of in FORMATS.items():
            write_text(folder / f"{table.title}.{suffix}", text_of(table))


def published_rows(name: str) -> pd.DataFrame:
    """Return the rows of an experiment in out/rows, joined with the published ones.

    Rows of a newer version of a method or of the measures replace the older rows, and so do rows of a method
    that was run again with other parameters.

    Raises
    ------
    InputError
        Outside of the project's folder; if rows are of no commit or of a modified checkout, mix versions,
        lack cases of the older rows that they replace, or are of methods whose code the project does not
        hold.
    """
    if not (PUBLISHED / "rows").is_dir():
        raise InputError(f"there is no {PUBLISHED / 'rows'} here; publish from the project's own folder")
    path, target = ROWS / f"{name}.csv", PUBLISHED / "rows" / f"{name}.csv"
    new = newest(read_csv(path))
    loose = new[new["env.modified"].ne(False) | new["env.commit"].isna()]
    if len(loose):
        raise InputError(
            f"{len(loose)} of {len(new)} rows of {path} come from a checkout with changes that are not "
            "committed, or from no commit: commit, and run them again with run.force=true"
        )
    targets = new.filter(regex=r"^method\.(.*\.)?target$")
    users = targets.map(lambda target: isinstance(target, str) and target.split(".")[0] not in OWN)
    if users.any(axis=None) or new.filter(items=["method.command"]).notna().any(axis=None):
        raise InputError(
            f"{path} has rows of methods or programs that are no part of this project, so that the commit "
            "does not hold their code: propose the methods as CONTRIBUTING.md describes"
        )
    rows = new
    if target.is_file():
        rows = pd.concat([_not_changed(newest(read_csv(target)), new), new], ignore_index=True)
    latest = rows.groupby("method.name")["method.version"].transform("max")
    of_latest = (rows["method.version"] == latest) & (rows["measures"] == numbers(rows, "measures").max())
    lost = set(rows[RUN].itertuples(index=False, name=None))
    lost -= set(rows[RUN][of_latest].itertuples(index=False, name=None))
    for method, task, _ in sorted(lost)[:1]:
        raise InputError(
            f"{path} has a newer version of {method} or of the measures, of which "
            f"{counted(len(lost), 'run', 'runs')} of the published rows, such as {task}, are missing"
        )
    rows = newest(rows[of_latest])
    require_one_version(rows)
    return rows


def _not_changed(old: pd.DataFrame, new: pd.DataFrame) -> pd.DataFrame:
    """Return the published rows without runs that `new` has with other parameters of the method."""
    run = [name for name in (*RUN, "task.source") if name in old and name in new]
    again, equal = (
        pd.MultiIndex.from_frame(old[names]).isin(pd.MultiIndex.from_frame(new[names]))
        for names in (run, [*run, "method.hash"])
    )
    return old[~again | equal]


def write_published(rows: Mapping[str, pd.DataFrame]) -> None:
    """Write the rows of experiments by name, and copy the figures with their names."""
    for name, own in rows.items():
        write_csv(PUBLISHED / "rows" / f"{name}.csv", own)
    drawn = [
        FIGURES / f"{name}{end}{suffix}" for name in rows for end in ("", "_time") for suffix in SUFFIXES
    ]
    for figure in (path for path in drawn if path.is_file()):
        with writing(PUBLISHED / "figures" / figure.name) as temporary:
            shutil.copyfile(figure, temporary)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", nargs="*", type=Path, help=f"{ROWS_HELP} (default: every CSV there)")
    add_out(parser, Path("out/tables"), "folder of the tables")
    text = "method to which differences are shown (default: Elastic if it is there, or the first method)"
    parser.add_argument("--reference", metavar="METHOD", help=text)
    text = "put the rows of these experiments in out/rows, their tables and figures into results/"
    parser.add_argument("--publish", action="store_true", help=text)
    text = "print the paper's numbers beside yours on a dataset: faust, tosca"
    parser.add_argument("--paper", nargs="+", metavar="DATASET", help=text)


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    if options.paper:
        print(paper_tables(options.paper))  # noqa: T201
        return 0
    if options.publish:
        rows = {name.stem: published_rows(name.stem) for name in options.rows}
        tables = [make_table(own, title=name) for name, own in rows.items()]  # all checks before all writes
        write_published(rows)
        write_tables(tables, PUBLISHED / "tables")
        return 0
    experiments = read_experiments(options.rows)
    if any(path.parent.resolve() == options.out.resolve() for path in map(rows_file, options.rows)):
        raise InputError(f"{options.out} holds the rows, which the tables would replace; name another -o")
    # All tables are made before the first is written.
    tables = [make_table(e.rows, title=e.name, reference=options.reference) for e in experiments]
    write_tables(tables, options.out)
    for table in tables:
        print(to_markdown(table))  # noqa: T201
    return 0

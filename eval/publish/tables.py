"""Tables from rows: ``sshade-eval tables [ROWS ...]`` writes CSV, Markdown and LaTeX.

A table is a pure function of rows: one line a method, means over its valid
runs in the paper's order of columns.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pandas as pd

from eval.publish.summary import Table, make_table, ranks
from eval.rows.experiment import read_experiments, rows_file
from eval.rows.frame import distinct
from eval.rows.store import ROWS_HELP
from sshade.errors import InputError
from sshade.io.files import make_folder, replacing


def to_csv(table: Table) -> str:
    """Numbers to six digits, without marks; where there are parts, a first column names them."""
    tables = {"all": table} | {part.title: part for part in table.parts}
    digits = "{:.6g}".format
    lines = pd.concat(
        {
            name: part.lines[["runs", "valid", "converged"]].join(part.means.map(digits, na_action="ignore"))
            for name, part in tables.items()
        },
        names=["part", "method"],
    )
    headings = {c.heading: f"{c.heading} [{c.unit}]" if c.unit else c.heading for c in table.columns}
    lines = lines if table.parts else lines.droplevel("part")
    return lines.rename(columns=headings).to_csv(lineterminator="\n")


def to_markdown(table: Table) -> str:
    """Best in bold, second best underlined; parts follow the notes."""
    marks = {0: "{}", 1: "**{}**", 2: "<u>{}</u>"}
    headings = ["method", "runs", *(column.label for column in table.columns)]
    head = [f"| {' | '.join(headings)} |", f"| --- |{' ---: |' * (len(headings) - 1)}"]

    def body(part: Table) -> list[str]:
        return [*head, *(f"| {' | '.join(texts)} |" for texts in cells(part, marks, not_available="n/a"))]

    out = [f"### {table.title}", "", *body(table), "", *(f"- {note}" for note in table.notes)]
    for part in table.parts:
        out += ["", f"#### {part.title}", "", *body(part)]
    return "\n".join(out) + "\n"


def to_latex(table: Table) -> str:
    """A booktabs tabular; best in bold, second best underlined, notes as comments."""
    marks = {0: "{}", 1: "\\textbf{{{}}}", 2: "\\underline{{{}}}"}
    units = {"%": " (\\%)", "deg": " ($^\\circ$)", "s": " (s)", "": ""}
    headings = ["method", "runs", *(_escape(c.heading) + units[c.unit] for c in table.columns)]
    out = [f"% {table.title}", *(f"% {note}" for note in table.notes)]
    out += [f"\\begin{{tabular}}{{l{'r' * (len(headings) - 1)}}}", "\\toprule"]
    out += [" & ".join(headings) + " \\\\"]
    for part in (table, *table.parts):
        out.append("\\midrule")
        if part is not table:
            out.append(f"\\multicolumn{{{len(headings)}}}{{l}}{{{_escape(part.title)}}} \\\\")
        body = cells(part, marks, not_available="--", escape=_escape)
        out += [" & ".join(texts) + " \\\\" for texts in body]
    out += ["\\bottomrule", "\\end{tabular}"]
    return "\n".join(out) + "\n"


FORMATS: dict[str, Callable[[Table], str]] = {"csv": to_csv, "md": to_markdown, "tex": to_latex}


def cells(
    table: Table, marks: dict[int, str], *, not_available: str, escape: Callable[[str], str] = str
) -> list[list[str]]:
    """The texts of a table, line by line: `marks` holds formats by rank, 0 for none."""
    rank = {column.heading: ranks(table, column) for column in table.columns}
    body = []
    for method, line in table.lines.iterrows():
        count = f"{line.runs}" if line.valid == line.runs else f"{line.valid}/{line.runs}"
        texts = [escape(method), count]
        for column in table.columns:
            mean = table.means.at[method, column.heading]
            if np.isnan(mean):
                texts.append(not_available if line.valid else line.outcome)
                continue
            text = marks[rank[column.heading].get(method, 0)].format(column.text(mean))
            if column.source == "iterations" and line.converged != "-":
                text += f" ({line.converged})"
            texts.append(text)
        body.append(texts)
    return body


def _escape(text: str) -> str:
    return "".join(f"\\{c}" if c in "&%$#_{}" else c for c in text)


def of_machine(rows: pd.DataFrame, text: str) -> pd.DataFrame:
    """The rows of the machines with `text` in their name.

    Raises
    ------
    InputError
        When there is no such machine.
    """
    found = rows[rows["env.machine"].str.contains(text, regex=False)]
    if found.empty:
        machines = "; ".join(distinct(rows, "env.machine"))
        raise InputError(f"no row is of a machine with {text!r} in its name; there are: {machines}")
    return found


def write_tables(tables: Iterable[Table], folder: Path) -> None:
    """Write tables in every format, as ``folder/<title>.<suffix>``."""
    make_folder(folder)
    for table in tables:
        for suffix, text_of in FORMATS.items():
            with replacing(folder / f"{table.title}.{suffix}") as temporary:
                temporary.write_text(text_of(table))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", nargs="*", type=Path, help=f"{ROWS_HELP} (default: every CSV there)")
    parser.add_argument("-o", "--out", type=Path, default=Path("out/tables"))
    parser.add_argument("--no-time", action="store_true", help="leave the times out")
    parser.add_argument("--machine", metavar="TEXT", help="only rows of the machine with this in its name")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    experiments = read_experiments(options.rows)
    if any(path.parent.resolve() == options.out.resolve() for path in map(rows_file, options.rows)):
        raise InputError(f"{options.out} holds the rows, which the tables would replace; name another -o")
    tables = []  # all of them, before anything is written
    for experiment in experiments:
        rows = of_machine(experiment.rows, options.machine or "")
        tables.append(make_table(rows, title=experiment.name, with_time=not options.no_time))
    write_tables(tables, options.out)
    for table in tables:
        print(to_markdown(table))  # noqa: T201
    return 0

"""Tables from rows: ``sshade-eval tables [ROWS ...]`` writes CSV, Markdown and LaTeX.

A table is a pure function of rows: one line a method, means over its valid
runs in the paper's order of columns.
"""

from __future__ import annotations

import argparse
import csv
import io
from collections.abc import Callable
from pathlib import Path

from eval.publish.summary import Table, make_table, ranks
from eval.rows.store import ROWS, ROWS_HELP, Row, read_csv, rows_file
from sshade.errors import InputError
from sshade.io.files import make_folder, replacing


def to_csv(table: Table) -> str:
    """Numbers to six digits, without marks; where there are parts, a first column names them."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    headings = [f"{c.heading} [{c.unit}]" if c.unit else c.heading for c in table.columns]
    first = ["part"] if table.parts else []
    writer.writerow([*first, "method", "runs", "valid", "converged", *headings])
    for name, part in (("all", table), *((part.title, part) for part in table.parts)):
        for line in part.lines:
            means = [line.means[c.heading] for c in table.columns]
            numbers = ["" if mean is None else format(mean, ".6g") for mean in means]
            first = [name] if table.parts else []
            writer.writerow([*first, line.method, line.runs, line.valid, line.converged, *numbers])
    return text.getvalue()


def to_markdown(table: Table) -> str:
    """Best in bold, second best underlined; parts follow the notes."""
    marks = {0: "{}", 1: "**{}**", 2: "<u>{}</u>"}
    headings = [
        "method",
        "runs",
        *(f"{c.heading} ({c.unit})" if c.unit else c.heading for c in table.columns),
    ]
    head = [f"| {' | '.join(headings)} |"]
    head.append("|" + "|".join([" --- ", *([" ---: "] * (len(headings) - 1))]) + "|")

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
    table: Table,
    marks: dict[int, str],
    *,
    not_available: str,
    escape: Callable[[str], str] = str,
) -> list[list[str]]:
    """The texts of a table, line by line: `marks` holds formats by rank, 0 for none."""
    by_column = {column.heading: ranks(table, column) for column in table.columns}
    body = []
    for line in table.lines:
        texts = [
            escape(line.method),
            str(line.runs) if line.valid == line.runs else f"{line.valid}/{line.runs}",
        ]
        for column in table.columns:
            mean = line.means[column.heading]
            if mean is None:
                texts.append(not_available if line.valid else line.outcome)
                continue
            text = marks[by_column[column.heading].get(line.method, 0)].format(column.text(mean))
            if column.source == "iterations" and line.converged != "-":
                text += f" ({line.converged})"
            texts.append(text)
        body.append(texts)
    return body


def _escape(text: str) -> str:
    return "".join(f"\\{c}" if c in "&%$#_{}" else c for c in text)


def of_machine(rows: list[Row], text: str) -> list[Row]:
    """The rows of the machines with `text` in their name.

    Raises
    ------
    InputError
        When there is no such machine.
    """
    found = [row for row in rows if text in row["env.machine"]]
    if not found:
        machines = "; ".join(sorted({row["env.machine"] for row in rows}))
        raise InputError(f"no row is of a machine with {text!r} in its name; there are: {machines}")
    return found


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", nargs="*", type=Path, help=f"{ROWS_HELP} (default: every CSV there)")
    parser.add_argument("-o", "--out", type=Path, default=Path("out/tables"))
    parser.add_argument("--no-time", action="store_true", help="leave the times out")
    parser.add_argument("--machine", metavar="TEXT", help="only rows of the machine with this in its name")


def command(options: argparse.Namespace) -> int:
    """Do it; return the exit code."""
    paths = [rows_file(name) for name in options.rows] or sorted(ROWS.glob("*.csv"))
    if not paths:
        raise InputError(f"{ROWS} holds no rows; `sshade-eval collect` makes them from runs")
    if any(path.parent.resolve() == options.out.resolve() for path in paths):
        raise InputError(f"{options.out} holds the rows, which the tables would replace; name another -o")
    tables = []  # all of them, before anything is written
    for path in paths:
        rows = of_machine(read_csv(path), options.machine or "")
        tables.append(make_table(rows, title=path.stem, with_time=not options.no_time))
    make_folder(options.out)
    for path, table in zip(paths, tables, strict=True):
        for suffix, write in FORMATS.items():
            with replacing(options.out / f"{path.stem}.{suffix}") as temporary:
                temporary.write_text(write(table))
        print(to_markdown(table))  # noqa: T201
    return 0

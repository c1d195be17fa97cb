"""Tables from rows: ``sshade-eval tables [ROWS ...]`` writes CSV, Markdown and LaTeX.

A table has one line per method, with means over the cases that all methods have. Its columns are in the order
of the paper's table. A second table holds further measures.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from eval.publish.columns import Column
from eval.publish.markdown import markdown_lines
from eval.publish.summary import MIXED_HELP, Table, make_table, ranks
from eval.rows.experiment import read_experiments
from eval.rows.files import ROWS_HELP, rows_file, write_text
from sshade.errors import InputError


def to_csv(table: Table) -> str:
    """Return numbers with six digits, without marks. If there are parts, a first column names them."""
    tables = {"all": table} | {part.title: part for part in table.parts}
    labels = {c.heading: f"{c.heading} [{c.unit}]" if c.unit else c.heading for c in table.columns}
    spreads = {heading: f"sd of {label}" for heading, label in labels.items()}

    def lines_of(part: Table) -> pd.DataFrame:
        values = [part.means.rename(columns=labels), part.spread.rename(columns=spreads)]
        texts = [numbers.map("{:.6g}".format, na_action="ignore") for numbers in values]
        return part.lines[["runs", "valid", "cases", "converged"]].join(texts)

    lines = pd.concat({name: lines_of(part) for name, part in tables.items()}, names=["part", "method"])
    empty = lines.isna().all()
    lines = lines.drop(columns=[name for name in spreads.values() if empty.get(name, False)])
    lines = lines if table.parts else lines.droplevel("part")
    return lines.to_csv(lineterminator="\n")


def to_markdown(table: Table) -> str:
    """Return both tables, the notes and the parts; best in bold, second best underlined."""
    marks = {0: "{}", 1: "**{}**", 2: "<u>{}</u>"}
    out: list[str] = []
    for part in (table, *table.parts):
        for heading, columns in part.views:
            labels = ["method", "runs", *(column.label for column in columns)]
            body = cells(part, columns, marks, not_available="n/a")
            out += [f"{'####' if out else '###'} {heading}", ""]
            out += [*markdown_lines(labels, body, left=["method"]), ""]
        out += [f"- {note}" for note in part.notes] + [""] * bool(part.notes)
    return "\n".join(out)


def to_latex(table: Table) -> str:
    """Return booktabs tabulars of the paper's and of further measures, with notes as comments."""
    marks = {0: "{}", 1: "\\textbf{{{}}}", 2: "\\underline{{{}}}"}
    units = {"%": " (\\%)", "deg": " ($^\\circ$)", "": ""}
    notes = [(part.title, note) for part in table.parts for note in part.notes]
    out = [f"% {note}" for note in (*table.notes, *(f"{title}: {note}" for title, note in notes))]
    for heading, columns in table.views:
        labels = ["method", "runs", *(_escape(c.heading) + units[c.unit] for c in columns)]
        out += [f"% {heading}", f"\\begin{{tabular}}{{l{'r' * (len(labels) - 1)}}}", "\\toprule"]
        out += [" & ".join(labels) + " \\\\"]
        for part in (table, *table.parts):
            out.append("\\midrule")
            if part is not table:
                out.append(f"\\multicolumn{{{len(labels)}}}{{l}}{{{_escape(part.title)}}} \\\\")
            body = cells(part, columns, marks, not_available="--", escape=_escape, spread=" $\\pm$ ")
            out += [" & ".join(texts) + " \\\\" for texts in body]
        out += ["\\bottomrule", "\\end{tabular}"]
    return "\n".join(out) + "\n"


FORMATS: dict[str, Callable[[Table], str]] = {"csv": to_csv, "md": to_markdown, "tex": to_latex}


def cells(
    table: Table,
    columns: Sequence[Column],
    marks: dict[int, str],
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
        Format of a number by its rank; 0 for no rank.
    not_available : str
        Text of a missing number.
    spread : str
        Text between a mean and its standard deviation.
    escape : callable
        Escapes a method's name.
    """
    own = {column.heading: column for column in table.columns}  # a part may have other formats
    rank = {heading: ranks(table, column) for heading, column in own.items()}
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
    return "".join(f"\\{c}" if c in "&%$#_{}" else c for c in text)


def write_tables(tables: Iterable[Table], folder: Path) -> None:
    """Write tables in every format, as ``folder/<title>.<suffix>``."""
    for table in tables:
        for suffix, text_of in FORMATS.items():
            write_text(folder / f"{table.title}.{suffix}", text_of(table))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", nargs="*", type=Path, help=f"{ROWS_HELP} (default: every CSV there)")
    parser.add_argument("-o", "--out", type=Path, default=Path("out/tables"))
    parser.add_argument("--mixed", action="store_true", help=MIXED_HELP)


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    experiments = read_experiments(options.rows)
    if any(path.parent.resolve() == options.out.resolve() for path in map(rows_file, options.rows)):
        raise InputError(f"{options.out} holds the rows, which the tables would replace; name another -o")
    # All tables are made before the first is written.
    tables = [make_table(e.rows, title=e.name, mixed=options.mixed) for e in experiments]
    write_tables(tables, options.out)
    for table in tables:
        print(to_markdown(table))  # noqa: T201
    return 0

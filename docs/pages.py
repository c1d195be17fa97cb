"""Update tables of the pages: ``python -m docs.pages``.

Run the script after rows or times were published, or options changed. It rewrites seven kinds of blocks, and
a test compares the blocks with the results and the code:

- ``<!-- table NAME: HEADING, ... -->`` to ``<!-- end -->`` has the named columns of all tables in
  ``results/tables/NAME.md``, below a caption. The block is empty if the file does not exist. With ``; METHOD,
  ...`` after the headings, only the rows of these methods appear, without marks: bold and underlined numbers
  are the best of the whole table.
- ``<!-- differences NAME: HEADING, ... -->`` to ``<!-- end -->`` has the named columns of the table of
  differences to a reference method, below a caption.
- ``<!-- paper NAME: HEADING, ... -->`` to ``<!-- end -->`` has columns of the paper's numbers beside ours:
  numbers of ``conf/paper.yaml``, and means of ``results/rows/NAME.csv``, or times.
- ``<!-- means NAME: HEADING; METHOD, ... -->`` to ``<!-- end -->`` has the means of one column in each pose
  and in all, and the paper's numbers.
- ``<!-- poses NAME: METHOD, ...; METHOD, RIVAL, ... -->`` to ``<!-- end -->`` has the mean distance to the
  true pose of methods in each pose, from ``results/rows/NAME.csv``, and the number of cases in which the
  first method after the semicolon is nearer than each of its rivals. A sentence below has the mean
  differences to the rivals, with their intervals.
- ``<!-- rows -->`` to ``<!-- end -->`` is a table whose rows begin with the name of an experiment. Its last
  column summarises ``results/rows/NAME.csv``.
- ``<!-- options -->`` to ``<!-- end -->`` is the reference of :mod:`sshade.problem.options`.

:func:`fill` writes other blocks.
"""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import pandas as pd

from docs.paper_numbers import beside_the_paper, pose_means
from eval.publish.columns import COLUMNS, TRUTH, markdown_table
from eval.publish.comparison import poses_of, subjects_of
from eval.publish.intervals import Resampling, differences, rounded
from eval.publish.summary import by_half
from eval.publish.tables import difference_text
from eval.rows.frame import numbers, of_methods, read_csv, valid
from sshade.core.errors import counted
from sshade.problem.options import GROUPS, REGIONS, default, described

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", ROOT / "results" / "README.md", *sorted((ROOT / "docs").glob("*.md")))
BLOCK = re.compile(
    r"(?P<begin><!-- "
    r"((?P<kind>table|differences|paper|poses|means) (?P<name>\w+): (?P<columns>[^\n;]+)"
    r"(; (?P<lines>[^\n]+))?"
    r"|rows|(?P<options>options))"
    r" -->\n)"
    r"(?P<old>.*?)(?P<end><!-- end -->)",
    re.DOTALL,
)

#: Beginnings of the notes that say on which half of the cases a table is, and the half.
HALVES = {"Held-out": "held-out cases", "Tuning": "tuning cases", "Cases of neither": "cases of neither half"}

#: Part of the heading of a table of differences.
DIFFERENCE = ": difference to "


def filled(text: str, results: Path = ROOT / "results", *, link: str = "results") -> str:
    """Return a page's text with its blocks rewritten; `link` is the path from the page to the results."""

    def new(block: re.Match[str]) -> str:
        if block["kind"] == "poses":
            path = results / "rows" / f"{block['name']}.csv"
            body = by_pose(path, block["columns"].split(", "), block["lines"].split(", "), link=link)
        elif block["kind"] == "means":
            path = results / "rows" / f"{block['name']}.csv"
            body = pose_means(path, block["columns"], block["lines"].split(", "), link=link)
        elif block["name"]:
            chosen = block["lines"].split(", ") if block["lines"] else None
            path = results / "tables" / f"{block['name']}.md"
            headings = block["columns"].split(", ")
            body = table(path, headings, kind=block["kind"], chosen=chosen, link=link)
        elif block["options"]:
            body = f"{reference()}\n"
        else:
            body = "".join(line_of_rows(line, results / "rows") for line in block["old"].splitlines())
        return f"{block['begin']}{body}{block['end']}"

    return BLOCK.sub(new, text)


def reference() -> str:
    """Return the reference of all options in Markdown: a table for each group."""
    lines: list[str] = []
    for group, names in GROUPS.items():
        lines += [f"### {group}", "", "| option | effect | values | default |", "|---|---|---|---|"]
        for name in names:
            option, regions = described()[name], default(name, REGIONS)
            usual = f"{default(name)}; with regions {regions}" if regions else default(name)
            lines.append(f"| `{name}` | {option.effect} | {option.values} | {usual} |")
        lines.append("")
    return "\n".join(lines)


def filled_page(page: Path) -> str:
    """Return the text of a page of :data:`PAGES` with its blocks rewritten."""
    link = "results" if page.parent == ROOT else "../results"
    return filled(page.read_text(encoding="utf-8"), link=link)


def table(path: Path, headings: list[str], *, kind: str, chosen: list[str] | None, link: str) -> str:
    """Return columns of the tables of a file below a caption, or nothing if the file does not exist.

    The `kind` "differences" takes the table of differences, "table" all others, and "paper" has the paper's
    numbers beside ours. `chosen` are the methods to take, in this order; None takes all.
    """
    if not path.is_file():
        return ""
    tables, notes = tables_of(path)
    apart = {title: grid for title, grid in tables.items() if DIFFERENCE in title}
    if kind == "differences":
        text, grids = f"{next(iter(apart)).partition(': ')[2]}.", list(apart.values())
    else:
        text = " ".join(caption_notes(notes))
        grids = [grid for title, grid in tables.items() if title not in apart]
        if kind == "paper":
            timed = "median (s)" in grids[0][0]
            grids = [beside_the_paper(path.stem, path.parents[1]), *(grids if timed else ())]
    # All grids have the same methods in the same order.
    joined = [sum(parts, []) for parts in zip(*grids, strict=True)]
    caption = f"[{path.stem}]({link}/tables/{path.name}): {text}\n\n"
    return f"{caption}{columns_of(joined, headings, path=path, chosen=chosen)}\n"


def by_pose(path: Path, methods: list[str], rivals: list[str], *, link: str) -> str:
    """Return the mean distances to the true pose by pose, or nothing if the file of rows does not exist.

    The cases are those of the first half that all named methods have. The last column counts the cases in
    which the first of `rivals` is nearer than each of the others.
    """
    if not path.is_file():
        return ""
    rows = valid(next(iter(by_half(read_csv(path)).values())))
    case = [rows["task.name"].map(poses_of(rows)).rename("pose"), rows["task.name"], rows["method.name"]]
    truth = numbers(rows, TRUTH).groupby(case).mean().unstack()
    truth = truth[[*dict.fromkeys([*methods, *rivals])]].dropna()
    first, *others = rivals
    nearer = rounded(truth[others].sub(truth[first], axis=0), truth) > 0

    def line(name: str, cases: pd.Index) -> list[str]:
        counts = " / ".join(map(str, nearer.loc[cases].sum()))
        means = [f"{mean:.2f}" for mean in truth.loc[cases, methods].mean()]
        return [name, *means, f"{counts} of {len(cases)}"]

    body = [line(pose, own.index) for pose, own in truth.groupby("pose")]
    head = ["pose", *methods, f"{first} nearer than {' / '.join(others)}"]
    text = f"mean distance to the true pose (% of the diagonal), and cases in which {first} is nearer"
    table = markdown_table(head, [*body, line("all", truth.index)], left=head[:1])
    caption = f"[{path.stem}]({link}/rows/{path.name}): {text}."
    return f"{caption}\n\n{table}\n\n{mean_differences(rows, truth, first, others)}\n"


def mean_differences(rows: pd.DataFrame, truth: pd.DataFrame, first: str, others: list[str]) -> str:
    """Return a sentence with the mean differences of a method to others, and their intervals."""
    truth = truth.droplevel("pose")
    subjects, poses = ([names[task] for task in truth.index] for names in (subjects_of(rows), poses_of(rows)))
    resampling = Resampling.of(subjects, poses)
    column = next(column for column in COLUMNS if column.source == TRUTH)
    found = {
        other: differences(truth, other, resampling, decimals=column.decimals).loc[first] for other in others
    }
    texts = [f"{other} {difference_text(column, own, '*{}*')}" for other, own in found.items()]
    return (
        f"Mean difference of {first} to {', to '.join(texts)}. In italics: the interval contains zero, so "
        "the means cannot tell."
    )


def tables_of(path: Path) -> tuple[dict[str, list[list[str]]], str]:
    """Return the first tables of a file by their headings, each a list of lines of cells, and their notes."""
    paragraphs = path.read_text(encoding="utf-8").split("\n\n")
    end = next(k for k, text in enumerate(paragraphs) if text.startswith("- "))
    tables = {
        heading: [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]
        for heading, text in pairwise(paragraphs[:end])
        if text.startswith("|")
    }
    return tables, paragraphs[end]


def columns_of(grid: list[list[str]], headings: list[str], *, path: Path, chosen: list[str] | None) -> str:
    """Return the named columns of a table as Markdown, of all methods or the chosen ones."""
    head, _, *body = grid
    places = [head.index(heading) for heading in ["method", *headings]]
    cells = [[line[place] for place in places] for line in body if line[0] != "identity"]
    if chosen:
        if missing := {*chosen} - {line[0] for line in cells}:
            raise ValueError(f"{path} has no method {', '.join(sorted(missing))}")
        plain = [[re.sub(r"\*\*|</?u>", "", cell) for cell in line] for line in cells]
        cells = [line for name in chosen for line in plain if line[0] == name]
    return markdown_table(["method", *headings], cells, left=["method"])


def caption_notes(text: str) -> list[str]:
    """The notes of a table for its caption: number, half and size of the cases, or the machine of times."""
    notes = [note.removeprefix("- ") for note in text.splitlines()]
    cases = next((note for note in notes if re.match(r"\d+ cases? of", note)), None)
    if cases is None:
        chosen = [note for note in notes if note.startswith("Machine")]
    else:
        half = next((HALVES[word] for note in notes for word in HALVES if note.startswith(word)), "cases")
        chosen = [re.sub("; means over all [^.]*", "", cases.replace("cases", half, 1))]
        chosen += re.findall(r"Of an older version than today's code: .*\.", text)
    return chosen + ["No ranks: too few subjects or poses." for note in notes if note.startswith("No ranks")]


def line_of_rows(line: str, folder: Path) -> str:
    """Return a row of the table of experiments with its last cell rewritten."""
    *cells, last = [cell.strip() for cell in line.strip("|").split("|")]
    if name := re.fullmatch(r"`(\w+)`", cells[0]):
        path = folder / f"{name[1]}.csv"
        last = rows_text(path) if path.is_file() else ""
    return f"| {' | '.join([*cells, last])} |\n"


def rows_text(path: Path) -> str:
    """Summarise an experiment: runs, cases, vertices, and the sum of the times of all runs, if known."""
    rows = of_methods(read_csv(path))
    done = valid(rows)
    sizes = [f"{n / 1000:.0f}k" for n in (done["task.vertices"].min(), done["task.vertices"].max())]
    hours = numbers(done, "seconds.total").sum() / 3600
    time = f"{hours:.1f} h" if hours >= 1 else f"{60 * hours:.0f} min" if hours > 1 / 60 else "under 1 min"
    cases = done["task.name"].nunique()
    runs = len(rows) if len(done) == len(rows) else f"{len(done)}/{len(rows)}"
    of_cases = f"{counted(cases, 'case', 'cases')} of {' to '.join(dict.fromkeys(sizes))}"
    return f"{runs} runs, {of_cases}" + (f": {time}" if hours else "")


def fill(page: Path, name: str, content: str) -> None:
    """Replace what is between ``<!-- NAME -->`` and ``<!-- end -->`` on a page."""
    before, start, rest = page.read_text(encoding="utf-8").partition(f"<!-- {name} -->\n")
    _, end, after = rest.partition("\n<!-- end -->")
    if not end:
        raise ValueError(f"{page} has no block {name!r}")
    page.write_text(f"{before}{start}{content}{end}{after}", encoding="utf-8")


if __name__ == "__main__":
    for chosen in PAGES:
        chosen.write_text(filled_page(chosen), encoding="utf-8")

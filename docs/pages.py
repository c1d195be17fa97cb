"""Update tables of the pages: ``python -m docs.pages``.

Run the script after rows or times were published, or options changed. It rewrites three kinds of blocks, and
a test compares the blocks with the results and the code:

- ``<!-- table NAME: HEADING, ... -->`` to ``<!-- end -->`` has the named columns of all tables in
  ``results/tables/NAME.md``, below a caption. The block is empty if the file does not exist. With ``; METHOD,
  ...`` after the headings, only the rows of these methods appear, without marks: bold and underlined numbers
  are the best of the whole table.
- ``<!-- rows -->`` to ``<!-- end -->`` is a table whose rows begin with the name of an experiment. Its last
  column summarises ``results/rows/NAME.csv``.
- ``<!-- options -->`` to ``<!-- end -->`` is the reference of :mod:`sshade.options`.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from docs.blocks import markdown
from eval.rows.frame import numbers, read_csv, valid
from sshade.options import reference

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
BLOCK = re.compile(
    r"(?P<begin><!-- "
    r"(table (?P<name>\w+): (?P<columns>[^\n;]+)(; (?P<lines>[^\n]+))?|rows|(?P<options>options))"
    r" -->\n)"
    r"(?P<old>.*?)(?P<end><!-- end -->)",
    re.DOTALL,
)

#: Beginnings of the notes that say on which half of the cases a table is, and the half.
HALVES = {"Held-out": "held-out ", "Tuning": "tuning "}

#: Rows of tables that are not methods.
REFERENCES = ("identity",)


def filled(text: str, results: Path = ROOT / "results", *, link: str = "results") -> str:
    """Return a page's text with its blocks rewritten; `link` is the path from the page to the results."""

    def new(block: re.Match[str]) -> str:
        if block["name"]:
            chosen = block["lines"].split(", ") if block["lines"] else None
            path = results / "tables" / f"{block['name']}.md"
            body = table(path, block["columns"].split(", "), chosen=chosen, link=link)
        elif block["options"]:
            body = f"{reference()}\n"
        else:
            body = "".join(line_of_rows(line, results / "rows") for line in block["old"].splitlines())
        return f"{block['begin']}{body}{block['end']}"

    return BLOCK.sub(new, text)


def filled_page(page: Path) -> str:
    """Return the text of a page of :data:`PAGES` with its blocks rewritten."""
    link = "results" if page.parent == ROOT else "../results"
    return filled(page.read_text(encoding="utf-8"), link=link)


def table(path: Path, headings: list[str], *, chosen: list[str] | None = None, link: str) -> str:
    """Return columns of the tables of a file below a caption, or nothing if the file does not exist.

    `chosen` are the methods to take, in this order; None takes all.
    """
    if not path.is_file():
        return ""
    paragraphs = path.read_text(encoding="utf-8").split("\n\n")
    end = next(k for k, text in enumerate(paragraphs) if text.startswith("- "))
    tables = [
        text for text in paragraphs[:end] if text.startswith("|")
    ]  # of the same methods, in the same order
    grids = [
        [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]
        for text in tables
    ]
    head, _, *body = [sum(parts, []) for parts in zip(*grids, strict=True)]
    places = [head.index(heading) for heading in ["method", *headings]]
    cells = [[line[place] for place in places] for line in body if line[0] not in REFERENCES]
    if chosen:
        if missing := {*chosen} - {line[0] for line in cells}:
            raise ValueError(f"{path} has no method {', '.join(sorted(missing))}")
        plain = [[re.sub(r"\*\*|</?u>", "", cell) for cell in line] for line in cells]
        cells = [line for name in chosen for line in plain if line[0] == name]
    caption = f"[{path.stem}]({link}/tables/{path.name}): {' '.join(caption_notes(paragraphs[end]))}\n\n"
    return f"{caption}{markdown(['method', *headings], cells)}\n"


def caption_notes(text: str) -> list[str]:
    """The notes of a table for its caption: number, half and size of the cases, or the machine of times."""
    notes = [note.removeprefix("- ") for note in text.splitlines()]
    cases = next((note for note in notes if re.match(r"\d+ cases? of", note)), None)
    if cases is None:
        chosen = [note for note in notes if note.startswith("Machine")]
    else:
        half = next((HALVES[word] for note in notes for word in HALVES if note.startswith(word)), "")
        chosen = [re.sub("; means over all [^.]*", "", cases.replace(" ", f" {half}", 1))]
    return chosen + [re.sub(r" \(.*", ".", note) for note in notes if note.startswith("Warning")]


def line_of_rows(line: str, folder: Path) -> str:
    """Return a row of the table of experiments with its last cell rewritten."""
    *cells, last = [cell.strip() for cell in line.strip("|").split("|")]
    if name := re.fullmatch(r"`(\w+)`", cells[0]):
        path = folder / f"{name[1]}.csv"
        last = rows_text(path) if path.is_file() else ""
    return f"| {' | '.join([*cells, last])} |\n"


def rows_text(path: Path) -> str:
    """Summarise an experiment: runs, cases, vertices, and the sum of the times of all runs."""
    rows = read_csv(path)
    done = valid(rows)
    sizes = [f"{n / 1000:.0f}k" for n in (done["task.vertices"].min(), done["task.vertices"].max())]
    hours = numbers(done, "seconds.total").sum() / 3600
    time = f"{hours:.1f} h" if hours >= 1 else f"{60 * hours:.0f} min" if hours > 1 / 60 else "under 1 min"
    cases = done["task.name"].nunique()
    runs = len(rows) if len(done) == len(rows) else f"{len(done)}/{len(rows)}"
    return f"{runs} runs, {cases} cases of {' to '.join(dict.fromkeys(sizes))}: {time}"


def main() -> int:
    """Rewrite the pages."""
    for page in PAGES:
        page.write_text(filled_page(page), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

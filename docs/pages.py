"""Put the committed numbers into the pages: ``python docs/pages.py``, after rows or times were published.

Pages hold measured numbers in blocks alone, which this writes and a test compares:

- ``<!-- table NAME: HEADING, ... -->`` to ``<!-- end -->``: these columns of the tables before the notes of
  ``results/tables/NAME.md``, with the notes that say what they are of. Nothing before it is published. With
  ``; METHOD, ...`` after the headings, its lines of these methods, without marks: those are of the whole.
- ``<!-- rows -->`` to ``<!-- end -->``: a table whose lines begin with the name of an experiment; its last
  cell tells of ``results/rows/NAME.csv``.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from eval.rows.frame import numbers, read_csv, valid

ROOT = Path(__file__).parents[1]
PAGES = (
    ROOT / "README.md",
    *(
        ROOT / "docs" / f"{name}.md"
        for name in ("results", "claims", "benchmark", "methods", "beyond", "deform")
    ),
)
BLOCK = re.compile(
    r"(?P<begin><!-- (table (?P<name>\w+): (?P<columns>[^\n;]+)(; (?P<lines>[^\n]+))?|rows) -->\n)"
    r"(?P<old>.*?)(?P<end><!-- end -->)",
    re.DOTALL,
)

#: Beginnings of the notes of a table that pages repeat: what rows it is of.
NOTES = ("Version", "Warning", "Held-out", "Tuning", "Machine", "Code", "Times faster", "Extrapolated")

#: Lines of tables that are no method.
REFERENCES = ("identity",)


def filled(text: str, results: Path = ROOT / "results", *, link: str = "results") -> str:
    """A page's text with its blocks as the committed results have them; `link` leads from it to them."""

    def new(block: re.Match[str]) -> str:
        if block["name"]:
            chosen = block["lines"].split(", ") if block["lines"] else None
            path = results / "tables" / f"{block['name']}.md"
            body = table(path, block["columns"].split(", "), chosen=chosen, link=link)
        else:
            body = "".join(line_of_rows(line, results / "rows") for line in block["old"].splitlines())
        return f"{block['begin']}{body}{block['end']}"

    return BLOCK.sub(new, text)


def filled_page(page: Path) -> str:
    """The text of one of :data:`PAGES`, anew."""
    link = "results" if page.parent == ROOT else "../results"
    return filled(page.read_text(encoding="utf-8"), link=link)


def table(path: Path, headings: list[str], *, chosen: list[str] | None = None, link: str) -> str:
    """Columns of the tables of a file, its place and notes before them; nothing where there is no file.

    `chosen` are the methods to take, in this order, by default all.
    """
    if not path.is_file():
        return ""
    paragraphs = path.read_text(encoding="utf-8").split("\n\n")
    end = next(k for k, text in enumerate(paragraphs) if text.startswith("- "))
    tables = [text for text in paragraphs[:end] if text.startswith("|")]  # of the same methods
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
    rule = ["---", *["---:"] * len(headings)]
    said = [note.removeprefix("- ") for note in paragraphs[end].splitlines()]
    said = [note for note in said if note.startswith(NOTES) or re.match(r"\d+ cases? of", note)]
    said = [re.sub(r" \(.*", ".", note) if note.startswith("Warning") else note for note in said]
    caption = f"[{path.stem}]({link}/tables/{path.name}): {' '.join(said)}\n\n"
    return caption + "".join(f"| {' | '.join(line)} |\n" for line in [["method", *headings], rule, *cells])


def line_of_rows(line: str, folder: Path) -> str:
    """A line of the table of experiments, its last cell written anew."""
    *cells, last = [cell.strip() for cell in line.strip("|").split("|")]
    if name := re.fullmatch(r"`(\w+)`", cells[0]):
        path = folder / f"{name[1]}.csv"
        last = rows_text(path) if path.is_file() else ""
    return f"| {' | '.join([*cells, last])} |\n"


def rows_text(path: Path) -> str:
    """The size of an experiment: runs and cases, vertices, and the time of its methods in all."""
    rows = read_csv(path)
    done = valid(rows)
    sizes = [f"{n / 1000:.0f}k" for n in (done["task.vertices"].min(), done["task.vertices"].max())]
    hours = numbers(done, "seconds.total").sum() / 3600
    time = f"{hours:.1f} h" if hours >= 1 else f"{60 * hours:.0f} min" if hours > 1 / 60 else "under 1 min"
    cases = done["task.name"].nunique()
    runs = len(rows) if len(done) == len(rows) else f"{len(done)}/{len(rows)}"
    return f"{runs} runs, {cases} cases of {' to '.join(dict.fromkeys(sizes))}: {time}"


def main() -> int:
    """Write the pages anew."""
    for page in PAGES:
        page.write_text(filled_page(page), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

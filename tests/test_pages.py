"""Tables of pages agree with the committed results, links work, and each picture is shown once."""

import re

import pandas as pd
import pytest

from docs.pages import PAGES, ROOT, filled_page
from eval.metrics import METRICS

#: A link of a page that leads to a file of the repository or to a heading.
LINK = re.compile(r"\]\((?!\w+://)([^)\s]+)\)")


def headings(page) -> set[str]:
    """Return the anchors of the headings of a page."""
    text = page.read_text(encoding="utf-8")
    return {re.sub(r"[^\w -]", "", h).lower().replace(" ", "-") for h in re.findall(r"^#+ (.+)", text, re.M)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_tables_of_a_page_are_up_to_date(page):
    assert filled_page(page) == page.read_text(encoding="utf-8"), "run: python -m docs.pages"


def test_the_speeds_of_the_readme_are_those_of_the_tables():
    measured = []
    for name in ("speed", "speed_hard"):
        fast = pd.read_csv(ROOT / "results" / "tables" / f"{name}.csv").set_index("method").loc["fast"]
        measured += [f"{fast['speed_up']:.0f}", f"{fast['speed_up_accelerated']:.0f}"]
    assert re.findall(r"\b1/(\d+)\b", (ROOT / "README.md").read_text(encoding="utf-8")) == measured


@pytest.mark.parametrize("page", sorted({*ROOT.glob("*.md"), *PAGES}), ids=lambda page: page.name)
def test_links_lead_to_files_and_headings(page):
    broken = []
    for link in LINK.findall(page.read_text(encoding="utf-8")):
        place, _, anchor = link.partition("#")
        target = page.parent / place if place else page
        if not target.exists() or (anchor and anchor not in headings(target)):
            broken.append(link)
    assert broken == []


def test_every_measure_is_explained():
    page = (ROOT / "docs" / "measures.md").read_text(encoding="utf-8")
    assert [name for name in METRICS if f"`{name}`" not in page] == []


def test_names_on_the_code_page_are_in_their_files():
    page = ROOT / "docs" / "code.md"
    rows = re.findall(r"^\|[^|]+\|([^|]+)\|([^|]+)\|$", page.read_text(encoding="utf-8"), re.M)
    named = [(LINK.findall(files), re.findall(r"`(\w+)`", names)) for files, names in rows]
    assert sum(len(names) for _, names in named) > 20
    missing = [
        (name, places)
        for places, names in named
        for name in names
        if not any(re.search(rf"\b{name}\b", (page.parent / place).read_text("utf-8")) for place in places)
    ]
    assert missing == []


def test_the_script_on_the_page_is_the_file():
    block = (ROOT / "docs" / "blender.md").read_text().split("```python\n")[1].split("\n```")[0]
    assert block.startswith("def main") and block in (ROOT / "docs" / "blender_task.py").read_text()

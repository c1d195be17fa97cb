"""Tables of pages are those of the committed results, links hold, and pictures can be drawn again."""

import re

import pytest

from docs.beyond import EXAMPLES
from docs.pages import PAGES, ROOT, filled, filled_page

#: A link of a page that leads to a file of the repository or to a heading.
LINK = re.compile(r"\]\((?!\w+://)([^)\s]+)\)")


def headings(page) -> set[str]:
    """The anchors of a page."""
    text = page.read_text(encoding="utf-8")
    return {re.sub(r"[^\w -]", "", h).lower().replace(" ", "-") for h in re.findall(r"^#+ (.+)", text, re.M)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_tables_of_a_page_are_up_to_date(page):
    assert filled_page(page) == page.read_text(encoding="utf-8"), "run: python -m docs.pages"


def test_a_changed_number_of_the_results_appears_on_the_page(tmp_path):
    (tmp_path / "tables").mkdir()
    (tmp_path / "rows").mkdir()
    text = "a\n<!-- table tiny: EL (%), FA (deg) -->\n<!-- end -->\nb\n"
    text += "<!-- rows -->\n| `tiny` | x | 3 s |\n<!-- end -->\n"
    text += "<!-- differences tiny: EL (%) -->\n<!-- end -->\n"
    assert filled(text, tmp_path) == text.replace("3 s", "")  # nothing is published
    table = "| method | volume | FA (deg) | EL (%) |\n| --- | ---: | ---: | ---: |\n| {} |\n"
    table += "| identity | 1 | 2 | 3 |"
    differs = "#### tiny: difference to elastic, by 3\n\n| method | EL (%) |\n| --- | ---: |\n| arap | +1 |"
    notes = "- 2 cases of 9 vertices; means over all of them.\n- Held-out cases.\n- Best in bold."
    for line in ("arap | 7 | **8** | 9", "arap | 7 | 8.5 | **6**"):
        _, _, angle, edge = line.split(" | ")
        written = (
            f"### tiny\n\n{table.format(line)}\n\n{differs}\n\n{notes}\n\n#### tiny: more\n\n| method |\n"
        )
        (tmp_path / "tables" / "tiny.md").write_text(written)
        text = filled(text, tmp_path)
        assert "[tiny](results/tables/tiny.md): 2 held-out cases of 9 vertices.\n\n" in text
        assert "difference to elastic, by 3.\n\n| method | EL (%) |\n| --- | ---: |\n| arap | +1 |\n" in text
        assert f"| --- | ---: | ---: |\n| arap | {edge} | {angle} |\n<!-- end -->\nb\n" in text


@pytest.mark.parametrize(
    "page", [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")], ids=lambda page: page.name
)
def test_links_lead_to_files_and_headings(page):
    broken = []
    for link in LINK.findall(page.read_text(encoding="utf-8")):
        place, _, anchor = link.partition("#")
        target = page.parent / place if place else page
        if not target.exists() or (anchor and anchor not in headings(target)):
            broken.append(link)
    assert broken == []


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


def test_the_pictures_of_beyond_are_there_and_small():
    page = ROOT / "docs" / "beyond_fast.md"
    places = re.findall(r"\]\((figures/[^)]+)\)", page.read_text(encoding="utf-8"))
    assert len(places) > 5 and len(set(places)) == len(places)
    assert [place for place in places if (page.parent / place).stat().st_size > 150_000] == []
    assert sorted(f"figures/beyond_{name}.png" for name in EXAMPLES) == sorted(places)

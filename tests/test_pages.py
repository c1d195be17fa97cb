"""Tables of pages agree with the committed results, links work, and each picture is shown once."""

import re

import pytest

from docs import gallery, pictures
from docs.pages import PAGES, ROOT, by_pose, filled, filled_page, reference
from eval.metrics import METRICS
from eval.rows.frame import to_frame, write_csv
from eval.rows.store import IDENTITY
from sshade.problem.options import GROUPS, described

#: A link of a page that leads to a file of the repository or to a heading.
LINK = re.compile(r"\]\((?!\w+://)([^)\s]+)\)")


def headings(page) -> set[str]:
    """Return the anchors of the headings of a page."""
    text = page.read_text(encoding="utf-8")
    return {re.sub(r"[^\w -]", "", h).lower().replace(" ", "-") for h in re.findall(r"^#+ (.+)", text, re.M)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_tables_of_a_page_are_up_to_date(page):
    assert filled_page(page) == page.read_text(encoding="utf-8"), "run: python -m docs.pages"


def test_the_reference_has_a_line_for_each_option():
    lines = reference().splitlines()
    for name in (name for names in GROUPS.values() for name in names):
        start = f"| `{name}` | {described()[name].effect}"
        assert sum(line.startswith(start) for line in lines) == 1, name


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


def test_nearer_counts_by_pose_are_those_of_the_rows(tmp_path):
    """Two subjects in two poses; a case that a named method lacks does not count."""
    truths = {
        ("sit", 0): {"paper": 2.0, "fast": 1.0, "elastic": 3.0, "other": 0.1},
        ("sit", 1): {"paper": 4.0, "fast": 3.0, "elastic": 2.0},
        ("walk", 0): {"paper": 1.0, "fast": 2.0, "elastic": 3.0},
        ("walk", 1): {"paper": 1.0, "fast": 0.0},
    }
    rows = [
        dict.fromkeys([*IDENTITY, "reason"], "x")
        | {"method.name": method, "task.name": f"x/{pose}/{subject}", "task.meta.source_pose": pose}
        | {"seed": 0, "status": "ok", "metric.truth_distance": truth, "method.version": 1, "measures": 1}
        for (pose, subject), of_methods in truths.items()
        for method, truth in of_methods.items()
    ]
    write_csv(tmp_path / "rows.csv", to_frame(rows))
    text = by_pose(tmp_path / "rows.csv", ["paper", "fast"], ["fast", "paper", "elastic"], link="r")
    assert text.splitlines()[2:] == [
        "| pose | paper | fast | fast nearer than paper / elastic |",
        "| --- | ---: | ---: | ---: |",
        "| sit | 3.00 | 2.00 | 2 / 1 of 2 |",
        "| walk | 1.00 | 2.00 | 0 / 1 of 1 |",
        "| all | 2.33 | 2.00 | 2 / 2 of 3 |",
    ]
    assert by_pose(tmp_path / "absent.csv", ["paper"], ["fast"], link="r") == ""


@pytest.mark.parametrize(
    "page", sorted({*ROOT.glob("*.md"), *PAGES}), ids=lambda page: str(page.relative_to(ROOT))
)
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


def test_pages_show_each_picture_of_the_program_once_and_pictures_are_small():
    text = "".join(
        (ROOT / "docs" / page).read_text(encoding="utf-8") for page in ("limits.md", "beyond.md", "edit.md")
    )
    assert sorted(re.findall(r"\]\(figures/(.+)\.png\)", text)) == sorted(pictures.PICTURES)
    for name in pictures.PICTURES:
        assert 1000 < (ROOT / "docs" / "figures" / f"{name}.png").stat().st_size < 150_000


def test_the_gallery_has_the_command_and_picture_of_each_example():
    page = gallery.PAGE.read_text(encoding="utf-8")
    for name, example in gallery.EXAMPLES.items():
        assert page.count(f"```\n{example.command}\n```") == 1, name
        assert page.count(f"](figures/gallery_{name}.png)") == 1, name


def test_the_script_on_the_page_is_the_file():
    block = (ROOT / "docs" / "blender.md").read_text().split("```python\n")[1].split("\n```")[0]
    assert block.startswith("def main") and block in (ROOT / "docs" / "blender_task.py").read_text()

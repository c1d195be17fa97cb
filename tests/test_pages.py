"""The pages' numbers are those of the committed results, and they have no others."""

from __future__ import annotations

import re

import numpy as np
import pytest
from PIL import Image

from docs import beyond
from docs.beyond import EXAMPLES, Example
from docs.pages import BLOCK, PAGES, ROOT, filled, filled_page
from tests.shapes import bumpy, held_ends

README, RESULTS, CLAIMS, BENCHMARK, METHODS, BEYOND, _DEFORM = (
    page.read_text(encoding="utf-8") for page in PAGES
)

#: After this heading docs/beyond.md has figures of trials.
TRIALS = "## Trials that no table holds"

#: Any block that a script writes, those of docs/scaling.py, docs/editing.py and docs/measures.py too.
WRITTEN = re.compile(r"<!-- [^\n]+ -->\n.*?<!-- end -->", re.DOTALL)
#: What other pages say in numbers that no run of this program gave: settings, the data, arithmetic, what
#: the paper or a survey of real poses says. In robustness.md a line names its command and commit.
STATED = {
    "edit.md": ["100,000 vertices", "8,000 vertices", "half the pixels"],
    "limits.md": ["14 vertices"],
    "measures.md": [
        "0.1 to 1.8 % | 0.25 to 2.3 % | 1.8 to 5 % | 2.6 to 7.2°",
        "falls by 13 %",
        "1 % larger",
        "120°",
        "95 % and 99 % of the area",
        "5 % or 1 % of the area",
        "4 % longer",
        "3,072 faces",
        "prefer the second",
        "up to 50 %",
    ],
    "method.md": ["five times"],
    "paper.md": ["1000 iterations", "the second command", "7 to 8.5 minutes", "15 hours", "in\nminutes"],
    "robustness.md": ["an hour on two cores", "98.7 %", "99.6 %", "96.9 %", "98.6 %", "24 GiB"],
    "scaling.md": [
        "seconds say little",
        "CPU seconds",
        "from a million vertices on",
        "100 million vertices",
        "about three times",
        "300,000 vertices",
        "More than half of the samples",
        "second half",
        "surface is faster",
        "715,827,882 faces",
        "357 million",
        "A hundred million",
        "second table",
    ],
    "start.md": ["20,000 vertices"],
}

#: What a quality, a time, a speed-up or a size is said with: a number and a unit, or words alone.
MEASURED = re.compile(
    r"(?<![\w.])\d[\d.,]*\s*(?:[%°×]|(?:k|M|x|h|s|ms|min|fps|deg|degrees|[KMGT]i?B|fold|times|million|thousand"
    r"|vertices|faces|frames|iterations|seconds?|minutes?|hours?|days?)\b)"
    r"|\b(?:(?:milli)?seconds?|minutes?|hours?|faster|slower|longer|twice|thrice|millions?|thousands?|hundreds?)\b"
    r"|\b(?:two|three|four|five|six|seven|eight|nine|ten|dozens?) (?:of )?times\b"
    r"|\b(?:half|third|quarter|fifth|tenth)s? (?:an?|of|as|the|less|more|that)\b"
)


def claims(text: str) -> list[str]:
    """What of a text that nothing generates reads like a measured number, line by line."""

    def prose(block):
        return "" if block["name"] else re.sub(r"\|[^|]*\|\n", "|\n", block["old"])

    return [line for line in BLOCK.sub(prose, text).splitlines() if MEASURED.search(line)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_is_what_the_committed_results_make_of_it(page):
    assert filled_page(page) == page.read_text(encoding="utf-8"), "run: python docs/pages.py"


def test_numbers_stand_in_generated_blocks_alone():
    assert [claims(page) for page in (README, RESULTS, CLAIMS, BENCHMARK, METHODS)] == [[]] * 5
    (table,) = (block["old"] for block in BLOCK.finditer(README))
    assert table.count("\n| ") > 5
    (rows,) = (block["old"] for block in BLOCK.finditer(BENCHMARK))
    assert rows.count("`") > 40
    assert [
        block["name"]
        for page in (RESULTS, CLAIMS)
        for block in BLOCK.finditer(page)
        if block["old"].count("\n| ") < 3
    ] == []
    told, found, trials = BEYOND.partition(TRIALS)
    assert found and claims(told) == [] and len(claims(trials)) > 10
    blocks = [block for block in BLOCK.finditer(told) if block["name"]]
    assert len(blocks) > 7
    assert [block["name"] for block in blocks if block["old"].count("\n| ") < 3] == []


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda page: page.name)
def test_other_pages_measure_nothing_in_their_prose(page):
    told, *_ = WRITTEN.sub("", page.read_text(encoding="utf-8")).partition(TRIALS)
    for stated in STATED.get(page.name, []):
        assert stated in told, f"{page.name} no longer says {stated!r}"
        told = told.replace(stated, "")
    assert claims(told) == []


@pytest.mark.parametrize(
    "claim",
    [
        "Deform meshes of 100,000 to 10,000,000 vertices by moving a few handles, in about a second.",
        "one sampling of a body takes 0.26 s",
        "**750x** less than Elastic",
        "five take 210 times less",
        "it holds the volume to 0.01 %",
        "angles change by 0.5°",
        "A bound mesh follows its handles 200 frames a second",
        "5 million vertices",
        "a body of 171k vertices",
        "`sshade_fine` takes ten times as long, half of the peak",
        "edges change a third less",
        "some minutes on two cores",
        "twice as fast",
        "3.0 GB of memory",
        "it is slower",
    ],
)
def test_a_measured_number_in_the_prose_is_found(claim):
    assert claims(f"{README}\n{claim}\n") == [claim]


def test_one_in_the_table_of_experiments_is_found_too():
    assert len(claims(BENCHMARK.replace("| tuning | ", "| tuning | in 3 s, ", 1))) == 1


def test_a_number_that_changed_in_the_results_shows(tmp_path):
    (tmp_path / "tables").mkdir()
    (tmp_path / "rows").mkdir()
    text = "a\n<!-- table tiny: EL (%), FA (deg) -->\n<!-- end -->\nb\n"
    text += "<!-- rows -->\n| `tiny` | x | 3 s |\n<!-- end -->\n"
    assert filled(text, tmp_path) == text.replace("3 s", "")  # nothing of it is published
    table = "| method | volume | FA (deg) | EL (%) |\n| --- | ---: | ---: | ---: |\n| {} |\n"
    table += "| identity | 1 | 2 | 3 |"
    notes = "- 2 cases of 9 vertices.\n- Held-out cases.\n- Best in bold."
    for line in ("arap | 7 | **8** | 9", "arap | 7 | 8.5 | **6**"):
        _, _, angle, edge = line.split(" | ")
        written = f"### tiny\n\n{table.format(line)}\n\n{notes}\n\n#### tiny: more\n\n| method |\n"
        (tmp_path / "tables" / "tiny.md").write_text(written)
        text = filled(text, tmp_path)
        assert "[tiny](results/tables/tiny.md): 2 cases of 9 vertices. Held-out cases.\n\n" in text
        assert f"| --- | ---: | ---: |\n| arap | {edge} | {angle} |\n<!-- end -->\nb\n" in text


def test_chosen_methods_come_in_their_order_without_marks_and_must_be_there(tmp_path):
    (tmp_path / "tables").mkdir()
    table = "| method | EL (%) |\n| --- | ---: |\n| a | **1** |\n| b | <u>2</u> |\n| c | 3 |\n| b | 4 |"
    (tmp_path / "tables" / "tiny.md").write_text(f"### tiny\n\n{table}\n\n- 2 cases of 9 vertices.\n")
    text = filled("<!-- table tiny: EL (%); b, a -->\n<!-- end -->\n", tmp_path, link="../there")
    assert text.startswith("<!-- table tiny: EL (%); b, a -->\n[tiny](../there/tables/tiny.md): 2 cases")
    assert text.endswith("| --- | ---: |\n| b | 2 |\n| b | 4 |\n| a | 1 |\n<!-- end -->\n")
    with pytest.raises(ValueError, match="has no method d$"):
        filled("<!-- table tiny: EL (%); d, a -->\n<!-- end -->\n", tmp_path)


@pytest.mark.parametrize(
    "page", [ROOT / "README.md", *(ROOT / "docs").glob("*.md")], ids=lambda page: page.name
)
def test_links_lead_to_files_and_headings(page):
    text = page.read_text(encoding="utf-8")
    places = [place for place in re.findall(r"\]\(([^)]+)\)", text) if "://" not in place]
    assert page not in PAGES[:2] or len(places) > 10
    headings = {
        re.sub(r"[^\w -]", "", h).lower().replace(" ", "-") for h in re.findall(r"^#+ (.+)", text, re.M)
    }
    broken = [place for place in places if place.startswith("#") and place[1:] not in headings]
    files = [place.partition("#")[0] for place in places if not place.startswith("#")]
    assert [*broken, *(place for place in files if not (page.parent / place).exists())] == []


def test_the_pictures_of_what_goes_beyond_the_paper_are_there_and_small():
    places = re.findall(r"\]\((figures/[^)]+)\)", BEYOND)
    assert len(places) > 5 and len(set(places)) == len(places)
    assert [place for place in places if (PAGES[1].parent / place).stat().st_size > 150_000] == []
    assert sorted(f"figures/beyond_{name}.png" for name in EXAMPLES) == sorted(places)


def test_a_picture_shows_the_shapes_side_by_side(tmp_path, monkeypatch):
    task = held_ends(bumpy(2))
    low = task.mesh.V[:, 2] < 0
    examples = {
        "plain": lambda: Example(task, [task.mesh.V], shown=low, handles=True),
        "coloured": lambda: Example(task, [task.mesh.V, 1.2 * task.mesh.V, task.mesh.V], top=10.0),
    }
    monkeypatch.setattr(beyond, "EXAMPLES", examples)
    monkeypatch.setattr(beyond, "FIGURES", tmp_path)
    for name in examples:
        beyond.draw(name)
    plain, coloured = (
        np.asarray(Image.open(tmp_path / f"beyond_{name}.png").convert("RGB")).astype(int)
        for name in examples
    )
    assert plain.shape[1] == beyond.WIDTH and coloured.shape[1] == 3 * beyond.WIDTH
    left, middle, right = np.split(coloured, 3, axis=1)
    assert np.abs(left - right).mean() < 1 < np.abs(left - middle).mean()
    blue = (plain[..., 2] > plain[..., 0] + 60).sum()
    assert blue > 20  # the handles

"""The README's numbers are those of the committed results, and it has no others."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import sshade
from docs.readme import BLOCK, filled
from eval.rows.splits import read_splits
from sshade.cli.configuration import CONFIGURATION
from tests.shapes import bumpy

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")

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


def test_the_readme_is_what_the_committed_results_make_of_it():
    assert filled(README) == README, "run: python docs/readme.py"


def test_numbers_stand_in_generated_blocks_alone():
    assert claims(README) == []
    blocks = {block["name"]: block["old"] for block in BLOCK.finditer(README)}
    assert blocks["bodies_25k"].count("\n| ") > 5 and blocks[None].count("`") > 40


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
    assert len(claims(README.replace("| tuning | ", "| tuning | in 3 s, ", 1))) == 1


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


def test_every_experiment_is_named_with_its_half():
    (rows,) = (block["old"] for block in BLOCK.finditer(README) if block["name"] is None)
    told = {
        name: half
        for line in rows.splitlines()[2:]
        for name in re.findall(r"`(\w+)`", line.split("|")[1])
        for half in [line.split("|")[2].strip()]
    }
    stated = {
        path.stem: re.search(r"^  split: (\w+)$", path.read_text(), re.MULTILINE)
        for path in CONFIGURATION.glob("experiment/*.yaml")
    }
    assert told == {name: match[1] for name, match in stated.items()}
    assert set(told.values()) <= {*read_splits(), "both"}


def test_the_python_does_what_it_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    body = bumpy(3)
    sshade.write("body.ply", body)
    names: dict = {}
    blocks = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(blocks) > 2
    for block in blocks:
        exec(block, names)
    leaning = sshade.read("leaning.ply").V
    assert np.abs(leaning[names["b"]] - names["bc"]).max() < 1e-6
    assert np.abs(names["shape"] - leaning).max() < 0.1 * body.diagonal


def test_links_lead_to_files():
    places = [place for place in re.findall(r"\]\(([^)#]+)\)", README) if "://" not in place]
    assert len(places) > 10
    assert [place for place in places if not (ROOT / place).exists()] == []

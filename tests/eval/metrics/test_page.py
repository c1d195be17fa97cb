"""docs/measures.md: its numbers are those of its script, and it explains every measure."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from eval.metrics import METRICS

DOCS = Path(__file__).parents[3] / "docs"
SCRIPT = runpy.run_path(str(DOCS / "measures.py"))
PAGE = (DOCS / "measures.md").read_text()


def rows(table: str) -> dict[str, dict[str, float]]:
    """Numbers of a Markdown table by line and column."""
    head, _, *lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]
    return {line[0]: dict(zip(head[1:], map(float, line[1:]), strict=True)) for line in lines}


@pytest.fixture(scope="module")
def computed():
    return {name: rows(SCRIPT["table"](name)) for name in SCRIPT["EXAMPLES"]}


def test_the_numbers_of_the_page_are_those_of_its_shapes(computed):
    for name, found in computed.items():
        printed = rows(PAGE.partition(f"<!-- {name} -->\n")[2].partition("\n<!-- end -->")[0])
        assert printed.keys() == found.keys()
        for shape, values in found.items():
            assert printed[shape] == pytest.approx(values, rel=0.01, abs=0.002), (name, shape)


def test_each_pair_of_shapes_is_told_apart_by_one_measure_and_fools_another(computed):
    for name, worse, better in (
        (
            "crease",
            ("bend", "bend_tail", "detail", "truth_normal", "volume"),
            ("edge", "angle", "distortion_99"),
        ),
        ("tails", ("distortion_99", "distortion_max", "collapsed"), ("edge", "angle", "distortion_95")),
        ("spike", ("spike", "distortion_max"), ("edge", "angle", "bend")),
    ):
        good, bad = computed[name].values()
        for column in good:
            assert column.split()[0] in worse + better
            assert (bad[column] > good[column]) == (column.split()[0] in worse), (name, column)
    larger, squeezed, pear = computed["size"].values()
    assert squeezed["volume (%)"] == 0 < larger["volume (%)"] and pear["area (%)"] == 0 < larger["area (%)"]
    assert min(squeezed["edge (%)"], pear["edge (%)"]) > 10 * larger["edge (%)"]


def test_every_measure_is_explained_and_every_picture_is_there():
    assert [name for name in METRICS if f"`{name}`" not in PAGE] == []
    pictures = [part.partition(")")[0] for part in PAGE.split("](figures/")[1:]]
    assert sorted(pictures) == [f"measures_{name}.png" for name in sorted(SCRIPT["EXAMPLES"])]
    for name in pictures:
        assert 1000 < (DOCS / "figures" / name).stat().st_size < 150_000

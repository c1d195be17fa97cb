"""Every claim of a page is written there, and intervals of the committed rows support it."""

from functools import cache
from pathlib import Path

import pandas as pd
import pytest

from eval.publish.columns import COLUMNS
from eval.publish.comparison import compare
from eval.publish.intervals import differences, interval
from eval.rows.frame import numbers, read_csv
from eval.rows.splits import HELD_OUT, TUNING, split_of

ROOT = Path(__file__).parents[3]

#: Page -> words on the page -> claims. A claim names a table and a half, a column, a method, the sign of its
#: difference to other methods, and the other methods. The interval of the difference lies below zero (<),
#: lies above zero (>), or contains zero (=). A table may have a kind of handles, such as peers/points.
CLAIMS = {
    "README.md": {
        "Edges and angles change less": [
            *(f"{t} held_out | EL | fine < fast" for t in ("bodies_170k", "bodies_25k")),
            *(f"{t} held_out | FA | fine < fast" for t in ("bodies_170k", "bodies_25k")),
        ],
        "With landmarks it keeps area": [
            *(f"{t} held_out | area | fast < accelerated_elastic" for t in ("bodies_170k", "bodies_25k")),
        ],
        "`fast` and `fine` are nearer to true poses than the other methods of the table": [
            f"bodies_170k held_out | truth | {method} < paper deformation_graph accelerated_elastic"
            for method in ("fast", "fine")
        ],
        "`fine` keeps the volume, and changes edges a third less than `fast`": [
            "bodies_170k held_out | EL | fine < fast",
            "bodies_170k held_out | volume | fine < fast paper deformation_graph accelerated_elastic",
        ],
    },
    "docs/results.md": {
        "`fast` and `fine` are nearest to the true poses": [
            f"bodies_170k held_out | truth | {method} < paper deformation_graph accelerated_elastic"
            for method in ("fast", "fine")
        ],
        "`fine` stretches much less": ["bodies_170k held_out | EL | fine < fast"],
        "`accelerated_elastic` stretches least": [
            "bodies_170k held_out | EL | accelerated_elastic < fine fast paper deformation_graph"
        ],
        "cannot tell `fine` and Elastic apart in EL and FA, and `fine` is nearer to the true poses": [
            "bodies_25k held_out | EL | fine = accelerated_elastic elastic",
            "bodies_25k held_out | FA | fine = accelerated_elastic elastic",
            "bodies_25k held_out | truth | fine < accelerated_elastic elastic",
        ],
        "`deformation_graph` and `paper` cannot be told apart in their distance to the true poses": [
            "bodies_25k held_out | truth | paper = deformation_graph"
        ],
    },
    "docs/tracks.md": {
        "`fast` and `fine` are nearer to the ground truth than Elastic": [
            "noisy_2mm held_out | truth | fast < elastic",
            "noisy_2mm held_out | truth | fine < elastic",
        ],
        "cannot tell `paper` from Elastic": ["noisy_2mm held_out | truth | elastic = paper"],
    },
    "docs/methods.md": {
        "it stretches least": [
            "bodies_170k held_out | EL | accelerated_elastic < fine fast paper deformation_graph"
        ],
        "in EL and FA; with regions it changes edges less": [
            "front_detail/regions held_out | EL | accelerated_elastic < fine-0.5",
        ],
        "without noise, it cannot be told apart from `fine`": [
            "bodies_25k held_out | EL | accelerated_elastic = fine",
            "bodies_25k held_out | FA | accelerated_elastic = fine",
        ],
    },
    "docs/claims.md": {
        "are far from zero in volume, EL and FA": [
            "table1 tuning | volume | paper < elastic",
            "table1 tuning | EL | paper > elastic",
            "table1 tuning | FA | paper > elastic",
        ],
        "They are nearer in the four poses of this table, and farther in the six [held-out poses]": [
            "table1 tuning | truth | paper < elastic accelerated_elastic",
            "bodies_170k held_out | truth | paper > accelerated_elastic",
        ],
        "Their normals are better in both": [
            "table1 tuning | normal | paper < elastic accelerated_elastic",
            "bodies_170k held_out | normal | paper < accelerated_elastic",
        ],
        "ARAP-SR changes edges and angles most": [
            f"table1 tuning | {column} | arap_sr > arap elastic deformation_graph paper_plain paper fast fine"
            for column in ("EL", "FA")
        ],
        "It changes edges, angles and area more than the other methods of the table below, but loses less": [
            *(f"table1 tuning | {x} | implicit_arap_cpu > arap elastic paper" for x in ("EL", "FA", "area")),
            "table1 tuning | volume | implicit_arap_cpu < elastic",
        ],
        "and stretches more than ARAP": ["table1 tuning | EL | accelerated_arap_sr > accelerated_arap arap"],
    },
    "docs/beyond.md": {
        "`fast` has more than `paper` and the deformation graph; five bodies cannot tell it from Elastic": [
            claim
            for table in ("bodies_170k", "bodies_25k")
            for claim in (
                f"{table} held_out | crossings | fast > paper deformation_graph",
                f"{table} held_out | crossings | fast = accelerated_elastic",
            )
        ],
        "**Creases** of `fine` are sharper than the creases of `paper`": [
            "bodies_170k held_out | bend 99.9 | fine > paper",
            "bodies_25k held_out | bend 99.9 | fine > paper",
        ],
        "Creases of `fast` are sharper at 25,000 vertices; at 170,000 vertices, five bodies cannot tell": [
            "bodies_25k held_out | bend 99.9 | fast > paper",
            "bodies_170k held_out | bend 99.9 | fast = paper",
        ],
        "**Spikes** at landmarks are larger with `fine` than with `fast`": [
            f"{table} held_out | spike | fine > fast" for table in ("bodies_170k", "bodies_25k")
        ],
    },
    "docs/beyond_fast.md": {
        "With regions, the area changes more than with Elastic": [
            "front_detail/regions held_out | area | fast > accelerated_elastic"
        ],
    },
    "docs/beyond_fine.md": {
        "Lower values of `detail` are nearer to the true poses": [
            f"front_detail {half} | truth | fine-{smaller} < fine-{larger}"
            for half in ("held_out", "tuning")
            for smaller, larger in (("0.0", "0.25"), ("0.25", "0.5"), ("0.5", "0.75"), ("0.75", "1.0"))
        ],
        "A detail of 0 is nearer than `fast` and stretches less": [
            f"front_detail {half} | {column} | fine-0.0 < fast"
            for half in ("held_out", "tuning")
            for column in ("truth", "EL")
        ],
        "Between 0.5 and 0.75, five bodies cannot tell which stretches more": [
            "front_detail held_out | EL | fine-0.5 = fine-0.75"
        ],
        "has the sharper creases and more faces that intersect others": [
            f"front_detail held_out | {column} | fine-0.5 > fine-0.75"
            for column in ("bend 99.9", "crossings")
        ],
    },
}


def words_of(page: str) -> str:
    """Return the text of a page as one line."""
    return " ".join((ROOT / page).read_text(encoding="utf-8").split())


@cache
def of_subjects(table: str, half: str) -> pd.DataFrame:
    """Return the means of each method and subject over the common cases of a half, of one kind of handles."""
    name, _, kind = table.partition("/")
    rows = read_csv(ROOT / "results" / "rows" / f"{name}.csv")
    rows = rows[rows["task.meta.handles"] == kind] if kind else rows
    return compare(rows[rows["task.name"].map(split_of) == half], COLUMNS[:-1]).of_subjects


def sign(table: str, half: str, column: str, method: str, other: str) -> str:
    """Return <, > or = if the interval of the difference of two methods is below, above or around zero."""
    assert half in (HELD_OUT, TUNING)
    values = of_subjects(table, half)[column].unstack("method.name")[[method, other]]
    assert len(values) >= 5
    _, low, high = differences(values, other).loc[method]
    return "<" if high < 0 else ">" if low > 0 else "="


@pytest.mark.parametrize(("page", "words"), [(page, words) for page in CLAIMS for words in CLAIMS[page]])
def test_intervals_support_the_claim(page, words):
    assert words in words_of(page)
    for claim in CLAIMS[page][words]:
        place, column, stated = claim.split(" | ")
        method, expected, *others = stated.split()
        found = {other: sign(*place.split(), column, method, other) for other in others}
        assert found == dict.fromkeys(others, expected), claim


def test_the_numbers_of_the_readme():
    words, times = words_of("README.md"), read_csv(ROOT / "results" / "timing" / "speed.csv")
    seconds = numbers(times, "seconds.total").groupby(times["method.name"]).median()
    assert "takes less than a four-hundredth of the time" in words
    assert 400 < seconds["elastic"] / seconds["fast"] < 600
    edges = of_subjects("bodies_170k", HELD_OUT)["EL"].unstack("method.name").mean()
    assert 0.3 < 1 - edges["fine"] / edges["fast"] < 0.4


def test_the_loss_of_volume_at_two_resolutions():
    tables = [read_csv(ROOT / "results" / "rows" / f"{name}.csv") for name in ("table1", "table1_lowres")]
    fine, coarse = (
        numbers(own, "metric.volume").groupby([own["task.meta.subject"], own["task.name"]]).mean()
        for own in (rows[rows["method.name"] == "elastic"] for rows in tables)
    )
    assert list(fine.index) == list(coarse.index) and len(fine) == 40
    low, high = interval((fine - coarse).groupby(level=0).mean().to_numpy()[:, None])
    words = words_of("docs/claims.md")
    assert f"loses {fine.mean():.2f} % of the volume at 170,000 vertices" in words
    assert f"and {coarse.mean():.2f} % at 7,000" in words
    assert f"the interval of the difference is {low.item():.2f} to {high.item():.2f} %" in words

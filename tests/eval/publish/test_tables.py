"""Tables: small tables by hand, common cases, seeds, and rows that must not be mixed."""

import numpy as np
import pytest
from eval_rows import lost, missing, row, table_of

from eval.metrics import METRICS
from eval.publish.columns import COLUMNS, REACHED, SUCCESS, TRANSFER_COLUMNS
from eval.publish.tables import to_latex
from eval.rows.store import TRUE_POSE
from sshade import InputError


def test_every_measure_has_a_place_in_a_table():
    shown = {column.source.removeprefix("metric.") for column in (*COLUMNS, *TRANSFER_COLUMNS)}
    # angle_relative is the formula in the paper's text; the paper's table deviates from it.
    assert METRICS.keys() - shown == {"angle_relative", "zero_area_faces"}


def test_success_is_the_share_of_all_runs_that_reach_their_handles():
    cases = [("t1", REACHED), ("t2", 1.01 * REACHED), ("t3", None)]
    rows = [row("a", task, metric__handle=gap) for task, gap in cases] + [lost("a", "t4"), missing("a", "t5")]
    assert table_of(*rows).means["success"].tolist() == [20.0]


@pytest.mark.parametrize(
    ("one", "two", "words"),
    [
        ({"task__meta__dataset": "faust"}, {"task__meta__dataset": "tosca"}, "2 datasets .faust, tosca"),
        (
            {"method__stiffness": 1.0},
            {"method__hash": "other", "method__stiffness": 2.0},
            r"'a' has rows of different parameters \(stiffness 1.0 and 2.0\)",
        ),
        ({}, {"method__hash": "other", "method__vertices": 60}, r"\(vertices None and 60\)"),
        ({}, {"task": "t1"}, "several rows for t1, seed 0"),
        ({}, {"method__version": 2}, "method 'a' has rows of the versions 1 and 2"),
        ({}, {"measures": 2}, "versions 1 and 2 of the measures"),
    ],
)
def test_rows_that_must_not_be_mixed_are_refused(one, two, words):
    with pytest.raises(InputError, match=words):
        table_of(row("a", **one), row("b"), row("a", **{"task": "t2", **two}))


def on(method, volumes, **changes):
    """Return a row of a method for each case t0, t1, and so on. A volume of None gives a failed run."""
    return [
        lost(method, f"t{i}") if volume is None else row(method, f"t{i}", metric__volume=volume, **changes)
        for i, volume in enumerate(volumes)
    ]


def test_means_ranks_and_worst_cases_are_over_the_cases_that_all_have():
    """Only method a finished the worst case. Means over all finished cases would make b look better."""
    rows = [*on("a", [2.0, 2.0, 2.0, 2.0, 2.0, 50.0]), *on("b", [3.0, 3.0, 3.0, 3.0, 1.0, None])]
    table = table_of(*rows)
    assert table.means["volume"].tolist() == [2.0, 2.6]
    assert table.lines["cases"].tolist() == [5, 5] and table.lines["competes"].all()
    (worst,) = table.parts
    assert worst.means["volume"].tolist() == [2.0, 3.0] and worst.places.isna().all(axis=None)


def test_a_result_without_a_measure_has_no_mean_of_the_others():
    rows = [*on("a", [2.0, 2.0, 2.0, 2.0, 50.0]), *on("b", [3.0] * 5)]
    rows[-1]["metric.volume"] = None  # of the worst case of a
    true = on(TRUE_POSE, [1.0] * 5)
    true[2]["metric.volume"] = None
    table = table_of(*rows, *true)
    assert np.isnan(table.means.loc[TRUE_POSE, "volume"]) and table.means.loc[TRUE_POSE, "area"] == 2
    assert table.means.loc["a", "volume"] == 11.6 and np.isnan(table.means.loc["b", "volume"])
    assert table.places["volume"].dropna().to_dict() == {"a": 1.0}
    assert np.isnan(table.parts[0].means.at["b", "volume"])  # of the worst case


def test_the_smaller_numbers_have_the_first_rank_in_every_column_with_ranks():
    own = [column.source.replace(".", "__") for column in COLUMNS if column.source != SUCCESS]
    values = {"good": 1.0, "bad": 2.0}
    rows = [
        row(name, f"bodies/subject_{k}", **dict.fromkeys(own, value + 0.01 * k))
        for name, value in values.items()
        for k in range(5)
    ]
    places = table_of(*rows).places
    ranked = {column.heading: column.ranked for column in COLUMNS}
    for heading, found in places.items():
        assert found.dropna().to_dict() == ({"good": 1, "bad": 2} if ranked[heading] else {}), heading
    assert sum(ranked.values()) > 15 and set(places) == set(ranked)


def test_a_case_counts_with_the_mean_over_its_seeds_and_the_spread_is_shown():
    volumes = {("t0", 0): 1.0, ("t0", 1): 3.0, ("t1", 0): 5.0, ("t1", 1): 9.0}
    seeded = [row("s", task, seed=seed, metric__volume=v) for (task, seed), v in volumes.items()]
    seeded.append(row("s", "t0", seed=2, metric__volume=2.0))  # one case alone: no spread over the cases
    plain = on("a", [3.0, 3.0])
    table = table_of(*seeded, *plain)
    assert table.means["volume"].to_dict() == {"a": 3.0, "s": 4.5}
    # The mean over the cases is 3 with seed 0 and 6 with seed 1.
    assert table.spread.at["s", "volume"] == pytest.approx(np.std([3.0, 6.0], ddof=1))
    assert np.isnan(table.spread.at["a", "volume"])


def test_parts_of_a_table_have_their_notes_and_the_differences_to_the_wanted_method():
    tasks = [(f"{kind}{k}", kind) for kind in ("points", "few & large") for k in range(5)]
    rows = [row(name, task, task__meta__handles=kind) for name in "ab" for task, kind in tasks]
    table = table_of(*rows, reference="b")
    assert {one.reference for one in (table, *table.parts[:2])} == {"b"}
    text = to_latex(table)
    assert r"{handles: few \& large}" in text and "\n% handles: few & large: Best in bold" in text

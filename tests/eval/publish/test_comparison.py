"""Comparisons in a table: common cases, missing cases, halves, seeds, and one version of the code."""

import numpy as np
import pytest
from eval_rows import lost, row, table_of

from eval.publish.tables import to_markdown

BODIES = "defaust-synthetic/subject_0"


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
    text = to_markdown(table)
    assert "| a | 6 | 2.00 |" in text and "| b | 5/6 | 2.60 |" in text  # no marks: the means are too close
    assert "| b | *+0.60 [-0.60, +1.00]* |" in text and table.over == "5 cases (each subject has one pose)"
    assert "means over 5 of 6, the cases for which every compared method has a result." in table.notes[0]
    assert "b: 1 failed (ValueError: no): t5." in table.notes
    (worst,) = table.parts
    assert worst.means["volume"].tolist() == [2.0, 3.0] and worst.places.isna().all(axis=None)


def test_the_headline_is_over_held_out_cases_and_tuning_cases_follow():
    held_out = [
        row(m, "defaust-new_bodies/subject_11/pose_3", metric__volume=v) for m, v in (("a", 1.0), ("b", 2.0))
    ]
    bodies = [f"{BODIES}{i}/pose_1" for i in range(2)]
    tuning = [row(m, body, metric__volume=v) for m, v in (("a", 4.0), ("b", 3.0)) for body in bodies]
    table = table_of(*held_out, *tuning, lost("c", bodies[0]))
    assert table.means["volume"].tolist() == [1.0, 2.0] and table.label == "held-out cases"
    (part,) = table.parts
    assert part.title == "tuning cases" and part.means["volume"].fillna(-1).tolist() == [4.0, 3.0, -1]
    text = to_markdown(table)
    headline, rest = text.split("#### tuning cases\n")
    assert headline.startswith("### t: held-out cases\n") and "#### tuning cases: further measures" in rest
    assert "Held-out cases: no constant of the project's methods was chosen on them." in headline
    assert "2 cases of" in rest and "constants of methods were chosen on them" in rest
    assert "c: 1 failed" in rest and "c: 1 failed" not in headline


def test_a_case_counts_with_the_mean_over_its_seeds_and_the_spread_is_shown():
    volumes = {("t0", 0): 1.0, ("t0", 1): 3.0, ("t1", 0): 5.0, ("t1", 1): 9.0}
    seeded = [row("s", task, seed=seed, metric__volume=v) for (task, seed), v in volumes.items()]
    plain = on("a", [3.0, 3.0])
    table = table_of(*seeded, *plain)
    assert table.means["volume"].to_dict() == {"a": 3.0, "s": 4.5}
    # The mean over the cases is 3 with seed 0 and 6 with seed 1.
    assert table.spread.at["s", "volume"] == pytest.approx(np.std([3.0, 6.0], ddof=1))
    assert np.isnan(table.spread.at["a", "volume"])

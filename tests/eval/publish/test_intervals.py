"""Intervals of paired differences over subjects, and ranks: closed forms, SciPy as the oracle, refusals."""

import re

import numpy as np
import pandas as pd
import pytest
from eval_rows import frame, lost, row, table_of
from scipy import special, stats

from eval.main import call
from eval.publish.intervals import BOOTSTRAP, LEAST, LEVEL, RESAMPLES, SEED, differences, interval, places
from eval.publish.summary import make_table, ranks
from eval.publish.tables import to_csv, to_latex, to_markdown
from eval.rows.frame import write_csv
from sshade.core.errors import InputError

METHODS = ("elastic", "near", "far")


def drawn(n, k=3, seed=0):
    return np.random.default_rng(seed).lognormal(size=(n, k))


def on_subjects(method, values, *, poses=1, seeds=1):
    """Return rows of a method whose metric.edge has a given mean for each subject.

    The values differ much between the poses and seeds of a subject.
    """
    return [
        row(
            method,
            f"bodies/subject_{subject}/pose_{pose}",
            task__meta__subject=subject,
            seed=seed,
            metric__edge=value * (1 + pose) * (1 + 2 * seed) / ((poses + 1) / 2 * seeds),
        )
        for subject, value in enumerate(values)
        for pose in range(poses)
        for seed in range(seeds)
    ]


def columns(table, heading):
    return table.differences[heading].loc["near"].tolist()


@pytest.mark.parametrize("n", range(LEAST, BOOTSTRAP))
def test_few_subjects_have_the_interval_of_the_paired_t_test(n):
    values = drawn(n)
    low, high = interval(values)
    for k in range(values.shape[1]):
        test = stats.ttest_rel(values[:, k] + 7.0, np.full(n, 7.0)).confidence_interval(LEVEL)
        assert (low[k], high[k]) == pytest.approx((test.low, test.high), rel=1e-9)


@pytest.mark.parametrize("n", (BOOTSTRAP, 10, 25))
def test_many_subjects_have_the_expanded_percentile_interval_of_a_bootstrap(n):
    values = drawn(n)
    low, high = interval(values)
    expanded = 1 - 2 * special.ndtr(stats.t.ppf((1 - LEVEL) / 2, n - 1) * np.sqrt(n / (n - 1)))
    found = [
        stats.bootstrap(
            (values,),
            np.mean,
            axis=0,
            method="percentile",
            confidence_level=level,
            n_resamples=RESAMPLES,
            rng=np.random.default_rng(SEED),
        ).confidence_interval
        for level in (expanded, LEVEL)
    ]
    assert low == pytest.approx(found[0].low, rel=1e-9) and high == pytest.approx(found[0].high, rel=1e-9)
    assert (high - low > found[1].high - found[1].low).all()


@pytest.mark.parametrize("n", (LEAST, BOOTSTRAP))
def test_equal_differences_have_an_interval_without_width(n):
    low, high = interval(np.tile([0.0, 0.25], (n, 1)))
    assert low == pytest.approx([0.0, 0.25]) and high == pytest.approx([0.0, 0.25])
    assert low[0] == high[0] == 0.0


@pytest.mark.parametrize("n", (1, LEAST - 1))
def test_too_few_subjects_have_neither_interval_nor_rank(n):
    assert np.isnan(interval(drawn(n))).all()
    table = table_of(
        *(r for k, name in enumerate(METHODS) for r in on_subjects(name, [k + 1.0] * n, poses=5))
    )
    assert table.differences == {} and table.places.isna().all(axis=None)
    assert table.means["EL"].to_dict() == {"elastic": 1.0, "far": 3.0, "near": 2.0}
    for text in (to_markdown(table), to_latex(table)):
        assert not re.search(r"\*\*|<u>|textbf|underline|difference to", text)
        assert f"No ranks and no intervals: the means are over {n} subject" in text
    assert "difference" not in to_csv(table)


def test_poses_and_seeds_of_a_subject_are_averaged_first():
    """Thirty runs of a method on five subjects give five values."""
    base, better = np.array([1.0, 2.0, 3.0, 4.0, 6.0]), np.array([0.5, 1.9, 2.0, 4.1, 4.0])
    many = [*on_subjects("elastic", base, poses=3, seeds=2), *on_subjects("near", better, poses=3, seeds=2)]
    one = [*on_subjects("elastic", base), *on_subjects("near", better)]
    expected = stats.ttest_rel(better, base).confidence_interval(LEVEL)
    for rows in (many, one):
        found = columns(table_of(*rows), "EL")
        assert found == pytest.approx([np.mean(better - base), expected.low, expected.high])


def test_a_subject_counts_once_however_many_poses_it_has():
    rows = [*on_subjects("elastic", [1.0] * 4), *on_subjects("near", [2.0, 2.0, 2.0, 2.0])]
    rows += [row(m, f"bodies/subject_0/pose_{k}", task__meta__subject=0, metric__edge=e)
             for k in (7, 8, 9) for m, e in (("elastic", 1.0), ("near", 6.0))]  # fmt: skip
    table = table_of(*rows)
    assert table.subjects == 4
    assert columns(table, "EL")[0] == pytest.approx(np.mean([(1 + 3 * 5) / 4, 1, 1, 1]))


def test_a_number_that_a_case_lacks_has_no_difference():
    rows = [*on_subjects("elastic", [1.0] * 4), *on_subjects("near", [2.0] * 4)]
    rows[-1]["metric.volume"] = None
    table = table_of(*rows)
    assert np.isnan(columns(table, "volume")).all() and not np.isnan(columns(table, "EL")).any()
    assert "| near | - | " in to_markdown(table)


@pytest.mark.parametrize("n", (5, 9))
def test_the_order_of_rows_changes_nothing(n):
    values = drawn(n, len(METHODS), seed=3)
    rows = [r for name, own in zip(METHODS, values.T, strict=True) for r in on_subjects(name, own, poses=2)]
    text = to_csv(table_of(*rows))
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(len(rows))
        assert to_csv(table_of(*(rows[k] for k in order))) == text


@pytest.mark.parametrize(
    ("names", "reference"),
    [(("arap", "elastic", "accelerated_elastic"), "elastic"), (("fast", "accelerated_elastic"),
     "accelerated_elastic"), (("zeta", "beta"), "beta")],
)  # fmt: skip
def test_differences_are_to_elastic_or_to_the_first_method(names, reference):
    table = table_of(*(r for name in names for r in on_subjects(name, [1.0, 2.0, 3.0])))
    assert table.reference == reference
    assert table.differences["EL"].loc[reference].tolist() == [0.0, 0.0, 0.0]


def test_methods_that_cannot_be_told_apart_from_the_best_share_its_rank():
    """Methods a and b differ by noise; c and e are worse for every subject; d varies a lot."""
    of_subjects = pd.DataFrame(
        {
            "a": [1.0, 1.1, 0.9, 1.0, 1.0],
            "b": [1.1, 1.0, 1.0, 0.9, 1.1],
            "c": [2.0, 2.2, 1.9, 2.1, 2.0],
            "d": [1.0, 1.0, 1.0, 1.0, 40.0],
            "e": [2.1, 2.1, 2.0, 2.0, 2.1],
        }
    )
    means = of_subjects.mean()
    found = places(of_subjects, means, means.round(2))
    assert found.to_dict() == {"a": 1, "b": 1, "d": 1, "c": 4, "e": 4}
    to_a = differences(of_subjects, "a")
    assert (to_a["low"] > 0).to_dict() == {"a": False, "b": False, "c": True, "d": False, "e": True}


def test_equal_printed_numbers_share_a_rank_although_their_difference_is_certain():
    of_subjects = pd.DataFrame({"a": [1.0] * 5, "b": [1.0001] * 5, "c": [1.1] * 5})
    means = of_subjects.mean()
    assert places(of_subjects, means, means.round(2)).to_dict() == {"a": 1, "b": 1, "c": 3}
    assert places(of_subjects, means, means.round(5)).to_dict() == {"a": 1, "b": 2, "c": 3}


def test_marks_are_those_of_the_ranks_and_a_rank_of_all_has_no_mark():
    noise = np.array([0.1, -0.1, 0.05, 0.0, -0.05])
    values = {"elastic": 1 + noise, "far": 3 + noise, "near": 1 - noise, "last": 9 + noise}
    table = table_of(*(r for name, own in values.items() for r in on_subjects(name, own)))
    assert ranks(table, "EL") == {"elastic": 1, "near": 1, "far": 2}
    assert ranks(table, "FA") == {} and table.places["FA"].eq(1).all()
    text = to_markdown(table)
    assert text.count("**1.00**") == 2 and text.count("<u>3.00</u>") == 1
    assert "\\textbf{1.00}" in to_latex(table) and "\\textit{+0.00 [" in to_latex(table)


def test_a_subject_without_a_number_is_the_mesh_of_its_name():
    rows = [row(m, f"{mesh}/{pose}") for m in "ab" for mesh in ("cat", "hand") for pose in "xyz"]
    assert "2 subjects" in table_of(*rows).notes[0] and table_of(*rows).differences == {}
    of_kinds = [r | {"task.meta.subject": 3} for r in rows]
    assert "1 subject;" in make_table(frame(*of_kinds), title="t").notes[0]


def test_the_reference_can_be_chosen(tmp_path, capsys):
    rows = [r for k, name in enumerate(METHODS) for r in on_subjects(name, [k + 1.0] * LEAST)]
    write_csv(tmp_path / "t.csv", frame(*rows))
    arguments = [str(tmp_path / "t.csv"), "-o", str(tmp_path / "tables"), "--reference"]
    assert call("tables", [*arguments, "near"]) == 0
    text = capsys.readouterr().out
    assert "difference to near, with its" in text and "-1.00 [-1.00, -1.00]" in text
    with pytest.raises(InputError, match="t has no method 'nobody'; it has elastic, far, near"):
        call("tables", [*arguments, "nobody"])
    write_csv(tmp_path / "t.csv", frame(*rows, lost("poor", "s0")))
    with pytest.raises(InputError, match="t has no differences to 'poor', which is not ranked; name one"):
        call("tables", [*arguments, "poor"])

"""Intervals of paired differences over subjects and poses, and ranks: brute force, coverage, refusals."""

import re

import numpy as np
import pandas as pd
import pytest
from eval_rows import frame, lost, row, table_of
from scipy import stats

from eval.main import call
from eval.publish.intervals import LEAST, LEVEL, Resampling, differences, interval, places
from eval.publish.summary import make_table, ranks
from eval.publish.tables import to_csv, to_latex, to_markdown
from eval.rows.frame import write_csv
from sshade.core.errors import InputError

METHODS = ("elastic", "near", "far")
#: Distance to the true pose of `fast` minus that of Elastic, five bodies (lines) in six poses, as published.
PUBLISHED = np.array(
    [
        [-0.43, -0.05, -0.19, -0.82, -0.93, -5.10],
        [-0.24, -0.29, -0.31, -1.15, -1.81, -1.11],
        [-0.19, -0.65, -0.30, -0.66, -1.26, -1.25],
        [-0.24, -0.10, -0.24, -0.64, -1.75, -3.45],
        [-0.08, -0.11, -0.12, -0.31, -1.53, -1.83],
    ]
)


def on_cases(method, values, *, seeds=1, of="edge"):
    """Return rows of a method with a measure in each pose (column) of each subject (line); NaN is no case."""
    return [
        row(
            method,
            f"bodies/subject_{subject}/pose_{pose}",
            task__meta__subject=subject,
            task__meta__source_pose=f"pose {pose}",
            seed=seed,
            **{f"metric__{of}": value * (1 + 2 * seed) / seeds},
        )
        for (subject, pose), value in np.ndenumerate(np.asarray(values, dtype=float))
        for seed in range(seeds)
        if not np.isnan(value)
    ]


def on_subjects(method, values):
    """Return rows of a method on subjects with one pose each."""
    return on_cases(method, np.asarray(values)[:, None])


def crossed(subjects, poses):
    """Return the resampling of all poses of all subjects."""
    names = [f"{k:02}" for k in range(max(subjects, poses))]
    return Resampling.of(np.repeat(names[:subjects], poses), np.tile(names[:poses], subjects))


def effects(random, shape, *, subject, pose, noise):
    """Return invented differences whose true mean is zero: subjects (line), poses (column), trials."""
    n, m, trials = shape
    parts = random.normal(0, subject, (n, 1, trials)), random.normal(0, pose, (1, m, trials))
    return sum(parts) + random.normal(0, noise, shape)


def tail(n):
    """Return the expanded tail of an interval over n subjects or poses."""
    return stats.norm.cdf(stats.t.ppf((1 - LEVEL) / 2, n - 1) * np.sqrt(n / (n - 1)))


def test_poses_count_as_well_as_subjects_in_the_published_difference():
    """Over subjects alone, the interval was [-1.21, -0.59], as if six other poses could change nothing."""
    base = 5 + np.zeros_like(PUBLISHED)
    rows = on_cases("elastic", base, of="truth_distance")
    rows += on_cases("fast", base + PUBLISHED, of="truth_distance")
    table = table_of(*rows)
    found = table.differences["truth"].loc["fast"]
    assert found["difference"] == pytest.approx(PUBLISHED.mean()) and table.over == "5 subjects and 6 poses"
    of_poses = stats.ttest_1samp(PUBLISHED.mean(axis=0), 0).confidence_interval()
    assert found["high"] - found["low"] > max(2 * (1.21 - 0.59), of_poses.high - of_poses.low)
    assert found["low"] < of_poses.low and found["high"] > -0.59
    assert "| method | nearer | volume (%) |" in to_markdown(table)
    assert re.search(r"\| fast \| 30/30 \| .* -0\.90 \[-2\.\d\d, -0\.\d\d\] \|", to_markdown(table))


def test_an_interval_is_that_of_brute_force_also_where_cases_are_missing():
    """Draw subjects and poses one by one, and collect the cases as often as both were drawn."""
    random = np.random.default_rng(5)
    values = effects(random, (9, 8, 1), subject=1.0, pose=2.0, noise=1.0)[:, :, 0] ** 2
    values[random.random(values.shape) < 0.3] = np.nan
    subject, pose = np.nonzero(~np.isnan(values))
    low, high = interval(values[subject, pose][:, None], Resampling.of(subject, pose))
    means = []
    for _ in range(12000):
        lines, columns = random.integers(9, size=9), random.integers(8, size=8)
        drawn = [values[line, column] for line in lines for column in columns]
        means.append(np.nanmean(drawn))
    expected = np.quantile(means, [tail(8), 1 - tail(8)])
    assert [low[0], high[0]] == pytest.approx(expected, abs=0.05 * (high[0] - low[0]))


def test_intervals_cover_the_true_difference_where_those_over_subjects_alone_do_not():
    random = np.random.default_rng(1)
    for kind in ({"subject": 1, "pose": 3}, {"subject": 2, "pose": 0.5}):
        values = effects(random, (25, 25, 1500), noise=1, **kind)
        low, high = interval(values.reshape(625, -1), crossed(25, 25))
        assert 0.935 < np.mean((low <= 0) & (high >= 0)) < 0.975
        over_subjects = stats.ttest_1samp(values.mean(axis=1), 0).confidence_interval(LEVEL)
        if kind["pose"] > kind["subject"]:
            assert np.mean((over_subjects.low <= 0) & (over_subjects.high >= 0)) < 0.6


@pytest.mark.parametrize("n", (LEAST["cases"], 10, 25))
@pytest.mark.parametrize("poses", (1, None), ids=["one pose", "one subject"])
def test_cases_are_drawn_where_there_is_one_subject_or_one_pose_of_each(n, poses):
    values = np.random.default_rng(0).lognormal(size=(n, 3))
    resampling = crossed(n, 1) if poses else crossed(1, n)
    why = "each subject has one pose" if poses else "there is one subject"
    assert str(resampling) == f"{n} cases ({why})"
    low, high = interval(values, resampling)
    found = stats.bootstrap(
        (values,), np.mean, axis=0, method="percentile", confidence_level=1 - 2 * tail(n), n_resamples=20000,
        rng=np.random.default_rng(7),
    ).confidence_interval  # fmt: skip
    width = found.high - found.low
    assert (abs(low - found.low) < 0.1 * width).all() and (abs(high - found.high) < 0.1 * width).all()


def test_poses_of_different_names_belong_to_their_subjects():
    """Animals have poses of their own; then a pose is drawn as often as any other, in a drawn subject."""
    subjects = np.repeat(np.arange(6), 4)
    resampling = Resampling.of(subjects, np.arange(24))
    assert resampling.counts == {"subjects": 6, "poses": 24}
    weights = resampling.weights
    assert weights.sum(axis=0) == pytest.approx(1.0)
    assert weights.mean(axis=1) == pytest.approx(np.full(24, 1 / 24), rel=0.05)
    values = np.repeat(np.random.default_rng(3).normal(size=6), 4)[:, None]
    one = interval(values[::4], crossed(6, 1))
    assert np.subtract(*interval(values, resampling)) < 0.9 * np.subtract(*one)  # not narrower


def test_equal_differences_have_an_interval_without_width():
    for resampling in (crossed(4, 4), crossed(16, 1)):
        low, high = interval(np.tile([0.0, 0.25], (16, 1)), resampling)
        assert low == pytest.approx([0.0, 0.25]) and high == pytest.approx([0.0, 0.25])
        assert low[0] == high[0] == 0.0


@pytest.mark.parametrize(
    ("subjects", "poses", "told"),
    [
        (2, 9, "over 2 subjects and 9 poses, and at least 3 subjects and 3 poses are needed"),
        (9, 2, "over 9 subjects and 2 poses, and at least 3 subjects and 3 poses are needed"),
        (4, 1, "over 4 cases (each subject has one pose), and at least 5 cases are needed"),
        (1, 1, "over 1 case (there is one subject), and at least 5 cases are needed"),
    ],
)
def test_too_few_subjects_or_poses_have_neither_interval_nor_rank(subjects, poses, told):
    assert np.isnan(interval(np.ones((subjects * poses, 1)), crossed(subjects, poses))).all()
    cases = np.ones((subjects, poses))
    table = table_of(*(r for k, name in enumerate(METHODS) for r in on_cases(name, (k + 1) * cases)))
    assert table.differences == {} and table.places.isna().all(axis=None)
    assert table.means["EL"].to_dict() == {"elastic": 1.0, "far": 3.0, "near": 2.0}
    for text in (to_markdown(table), to_latex(table)):
        assert not re.search(r"\*\*|<u>|textbf|underline|difference to|nearer", text)
        assert f"No ranks and no intervals: the means are {told}." in text
    assert "difference" not in to_csv(table)


def test_seeds_are_averaged_first_and_each_case_counts_once():
    random = np.random.default_rng(2)
    base, better = random.lognormal(size=(2, 5, 6))
    one = table_of(*on_cases("elastic", base), *on_cases("near", better))
    many = table_of(*on_cases("elastic", base, seeds=2), *on_cases("near", better, seeds=2))
    expected = one.differences["EL"].loc["near"].tolist()
    assert many.differences["EL"].loc["near"].tolist() == pytest.approx(expected)
    assert one.differences["EL"].at["near", "difference"] == pytest.approx((better - base).mean())
    assert one.differences["EL"].at["near", "smaller"] == (better < base).sum()


def test_a_number_that_a_case_lacks_has_no_difference():
    rows = [*on_subjects("elastic", [1.0] * 5), *on_subjects("near", [2.0] * 5)]
    rows[-1]["metric.volume"] = None
    table = table_of(*rows)
    assert np.isnan(table.differences["volume"].loc["near"][["difference", "low", "high"]]).all()
    assert not np.isnan(table.differences["EL"].loc["near"]).any()
    assert "| near | - | " in to_markdown(table)


def test_the_order_of_rows_changes_nothing():
    values = np.random.default_rng(3).lognormal(size=(len(METHODS), 5, 4))
    rows = [r for name, own in zip(METHODS, values, strict=True) for r in on_cases(name, own)]
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
    table = table_of(*(r for name in names for r in on_subjects(name, [1.0, 2.0, 3.0, 4.0, 5.0])))
    assert table.reference == reference
    assert table.differences["EL"].loc[reference].tolist() == [0.0, 0.0, 0.0, 0]


def test_methods_that_cannot_be_told_apart_from_the_best_share_its_rank():
    """Methods a and b differ by noise; c and e are worse for every subject; d varies a lot."""
    of_cases = pd.DataFrame(
        {
            "a": [1.0, 1.1, 0.9, 1.0, 1.0],
            "b": [1.1, 1.0, 1.0, 0.9, 1.1],
            "c": [2.0, 2.2, 1.9, 2.1, 2.0],
            "d": [1.0, 1.0, 1.0, 1.0, 40.0],
            "e": [2.1, 2.1, 2.0, 2.0, 2.1],
        }
    )
    means = of_cases.mean()
    found = places(of_cases, means, means.round(2), crossed(5, 1))
    assert found.to_dict() == {"a": 1, "b": 1, "d": 1, "c": 4, "e": 4}
    to_a = differences(of_cases, "a", crossed(5, 1))
    assert (to_a["low"] > 0).to_dict() == {"a": False, "b": False, "c": True, "d": False, "e": True}


def test_equal_printed_numbers_share_a_rank_although_their_difference_is_certain():
    of_cases = pd.DataFrame({"a": [1.0] * 5, "b": [1.0001] * 5, "c": [1.1] * 5})
    means, one_pose = of_cases.mean(), crossed(5, 1)
    assert places(of_cases, means, means.round(2), one_pose).to_dict() == {"a": 1, "b": 1, "c": 3}
    assert places(of_cases, means, means.round(5), one_pose).to_dict() == {"a": 1, "b": 2, "c": 3}


def test_marks_are_those_of_the_ranks_and_a_rank_of_all_has_no_mark():
    noise = np.array([0.1, -0.1, 0.05, 0.0, -0.05])
    values = {"elastic": 1 + noise, "far": 3 + noise, "near": 1 - noise, "last": 9 + noise}
    table = table_of(*(r for name, own in values.items() for r in on_subjects(name, own)))
    assert ranks(table, "EL") == {"elastic": 1, "near": 1, "far": 2}
    assert ranks(table, "FA") == {} and table.places["FA"].eq(1).all()
    text = to_markdown(table)
    assert text.count("**1.00**") == 2 and text.count("<u>3.00</u>") == 1
    assert "\\textbf{1.00}" in to_latex(table) and "\\textit{+0.00 [" in to_latex(table)


def test_a_subject_without_a_number_is_the_mesh_of_its_name_and_a_pose_without_a_name_its_number():
    rows = [row(m, f"{mesh}/{pose}") for m in "ab" for mesh in ("cat", "hand") for pose in "xyz"]
    assert "2 subjects" in table_of(*rows).notes[0] and table_of(*rows).differences == {}
    of_one = [r | {"task.meta.subject": 3} for r in rows]
    assert "1 subject;" in make_table(frame(*of_one), title="t").notes[0]
    assert table_of(*of_one).over == "6 cases (there is one subject)"
    numbered = [
        row(m, f"{mesh}/{pose}", task__meta__pose=pose) for m in "ab" for mesh in "stuvw" for pose in range(4)
    ]
    assert table_of(*numbered).over == "5 subjects and 4 poses"


def test_the_reference_can_be_chosen(tmp_path, capsys):
    rows = [r for k, name in enumerate(METHODS) for r in on_subjects(name, [k + 1.0] * LEAST["cases"])]
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

"""Intervals of paired differences over subjects and poses, and ranks: brute force, coverage, refusals."""

import math
from itertools import combinations_with_replacement

import numpy as np
import pandas as pd
import pytest
from eval_rows import row, table_of
from scipy import stats

from eval.publish import resamples
from eval.publish.columns import Column
from eval.publish.intervals import LEVEL, Resampling, differences, interval, places

METHODS = ("elastic", "near", "far")
EDGE = Column("edge", "%", "metric.edge", 2)


def meta(subject, pose):
    return {"task__meta__subject": subject, "task__meta__source_pose": f"pose {pose}"}


def on_cases(method, values):
    """Return rows of a method with a measure in each pose (column) of each subject (line)."""
    return [
        row(method, f"bodies/subject_{s}/pose_{p}", **meta(s, p), metric__edge=value)
        for (s, p), value in np.ndenumerate(np.asarray(values, dtype=float))
    ]


def crossed(subjects, poses):
    """Return the resampling of all poses of all subjects."""
    names = [f"{k:02}" for k in range(max(subjects, poses))]
    return Resampling.of(np.repeat(names[:subjects], poses), np.tile(names[:poses], subjects))


def tail(n):
    """Return the expanded tail of an interval over n subjects or poses."""
    return stats.norm.cdf(stats.t.ppf((1 - LEVEL) / 2, n - 1) * np.sqrt(n / (n - 1)))


def test_an_interval_is_that_of_brute_force_also_where_cases_are_missing():
    """Draw subjects and poses, and collect the cases as often as both were drawn."""
    random = np.random.default_rng(5)
    values = (random.normal(size=(9, 1)) + random.normal(0, 2, (1, 8)) + random.normal(size=(9, 8))) ** 2
    values[random.random(values.shape) < 0.3] = np.nan
    subject, pose = np.nonzero(~np.isnan(values))
    low, high = interval(values[subject, pose][:, None], Resampling.of(subject, pose))
    lines, columns = random.integers(9, size=(12000, 9)), random.integers(8, size=(12000, 8))
    means = np.nanmean(values[lines[:, :, None], columns[:, None]], axis=(1, 2))
    expected = np.quantile(means, [tail(8), 1 - tail(8)])
    assert [low[0], high[0]] == pytest.approx(expected, abs=0.05 * (high[0] - low[0]))


def drawn(n):
    """Yield each way to draw n of n things, as counts, with its probability."""
    for way in combinations_with_replacement(range(n), n):
        counts = np.bincount(way, minlength=n)
        yield counts, math.factorial(n) / math.prod(map(math.factorial, counts)) / n**n


@pytest.mark.parametrize(("subjects", "poses"), [(3, 3), (5, 4), (4, 6), (8, 1), (1, 8)])
def test_an_interval_is_that_of_all_resamples(subjects, poses, monkeypatch):
    monkeypatch.setattr(np.random, "default_rng", None)  # none is drawn
    monkeypatch.setattr(resamples, "WAYS", math.comb(2 * min(subjects, poses) - 1, min(subjects, poses)))
    resamples.ways.cache_clear()
    values = np.random.RandomState(1).lognormal(size=(subjects, poses)) - 1
    means, chances = zip(
        *((a @ values @ b / values.size, p * q) for a, p in drawn(subjects) for b, q in drawn(poses)),
        strict=True,
    )
    order = np.argsort(means)
    below, n = np.cumsum(np.array(chances)[order]), (max if 1 in (subjects, poses) else min)(subjects, poses)
    expected = np.array(means)[order[np.searchsorted(below, [tail(n), 1 - tail(n)])]]
    low, high = interval(values.reshape(-1, 1), crossed(subjects, poses))
    assert [low[0], high[0]] == pytest.approx(expected, abs=np.ptp(values) / 500)


def test_an_interval_is_within_the_values_also_where_cases_are_missing():
    values = np.random.default_rng(2).lognormal(size=(3, 3)) ** 2
    subject, pose = np.nonzero(values > np.quantile(values, 0.3))
    own = values[subject, pose]
    low, high = interval(own[:, None], Resampling.of(subject, pose))
    assert own.min() <= low[0] < high[0] <= own.max()


def test_where_resamples_are_too_many_the_drawn_ones_give_the_interval_within_their_error(monkeypatch):
    values, resampling = np.random.default_rng(3).lognormal(size=(42, 1)), crossed(7, 6)
    exact = np.ravel(interval(values, resampling))
    monkeypatch.setattr(resamples, "WAYS", 100)
    resamples.ways.cache_clear()
    found = np.ravel(interval(values, resampling))
    resamples.ways.cache_clear()
    width = exact[1] - exact[0]
    assert 0 < exact[0] - found[0] < 0.1 * width and 0 < found[1] - exact[1] < 0.1 * width


def test_neither_last_bits_nor_more_digits_than_are_printed_tell_methods_apart():
    random = np.random.default_rng(0)
    of_cases = pd.DataFrame({"a": random.random(12)})
    of_cases["b"] = of_cases["a"] + random.choice([-1e-16, 1e-16], 12)
    of_cases["c"] = of_cases["a"] + 0.0049
    of_cases["d"] = of_cases["a"] + 0.0151
    found = differences(of_cases, "a", crossed(4, 3), decimals=2)
    assert found.loc["b"].tolist() == [0.0, 0.0, 0.0, 0]
    assert found["low"].tolist() == [0.0, 0.0, 0.0, 0.02] and found["smaller"].tolist() == [0, 0, 0, 0]
    assert places(of_cases, crossed(4, 3), EDGE).to_dict() == {"a": 1, "b": 1, "c": 1, "d": 4}


@pytest.mark.parametrize(("subjects", "poses"), [(2, 9), (4, 1)])
def test_too_few_subjects_or_poses_have_neither_interval_nor_rank(subjects, poses):
    assert np.isnan(interval(np.ones((subjects * poses, 1)), crossed(subjects, poses))).all()
    cases = np.ones((subjects, poses))
    table = table_of(*(r for k, name in enumerate(METHODS) for r in on_cases(name, (k + 1) * cases)))
    assert table.differences == {} and table.places.isna().all(axis=None)
    assert table.means["EL"].to_dict() == {"elastic": 1.0, "far": 3.0, "near": 2.0}
    told = {
        2: "over 2 subjects and 9 poses, and at least 3 subjects and 3 poses are needed",
        4: "over 4 cases (each subject has one pose), and at least 5 cases are needed",
    }
    assert f"No ranks and no intervals: the means are {told[subjects]}." in " ".join(table.notes)


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
    assert places(of_cases, crossed(5, 1), EDGE).to_dict() == {"a": 1, "b": 1, "d": 1, "c": 4, "e": 4}
    to_a = differences(of_cases, "a", crossed(5, 1), decimals=2)
    assert (to_a["low"] > 0).to_dict() == {"a": False, "b": False, "c": True, "d": False, "e": True}

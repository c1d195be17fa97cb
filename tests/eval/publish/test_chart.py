"""The chart of time against truth: means over common cases, times of a benchmark, the methods none beats."""

import pytest
from eval_rows import frame, lost, row

from eval.publish.figures import chart_of, time_and_truth, unbeaten
from sshade.core.errors import InputError


def timed(method, task, seconds, truth, **changes):
    return row(method, task, seconds__total=seconds, metric__truth_distance=truth, **changes)


def test_means_are_over_the_cases_that_all_have_and_seeds_count_once():
    rows = [timed("a", "t1", 1.0, 2.0), timed("a", "t2", 3.0, 4.0), timed("a", "t3", 99.0, 99.0)]
    rows += [timed("b", "t1", 5.0, 1.0), timed("b", "t2", 7.0, 3.0), lost("b", "t3")]
    rows += [timed("b", "t1", 7.0, 3.0, seed=1), timed("nothing", "t1", 0.0, 9.0)]
    rows[-1]["method.target"] = "baselines.identity.identity"
    assert time_and_truth(frame(*rows)) == {"a": (2.0, 3.0), "b": (6.5, 2.5)}


def test_times_of_a_benchmark_replace_those_of_the_runs():
    rows = frame(*(timed(name, "t1", 1.0, 2.0) for name in "ab"))
    times = [
        row("a", seconds__total=s, kept=k) for s, k in ((4.0, True), (5.0, True), (6.0, True), (99.0, False))
    ]
    assert time_and_truth(rows, frame(*times)) == {"a": (5.0, 2.0)}
    with pytest.raises(InputError, match="no method was timed"):
        time_and_truth(rows, frame(row("c", kept=True)))
    with pytest.raises(InputError, match="the times differ in env.machine"):
        time_and_truth(rows, frame(*times, row("a", env__machine="other", kept=True)))


def test_a_chart_needs_two_methods_with_a_truth():
    one = frame(timed("a", "t1", 1.0, 2.0), row("b"))
    assert chart_of(one) is None
    figure = chart_of(frame(timed("a", "t1", 1.0, 2.0), timed("b", "t1", 9.0, 1.0)))
    (axes,) = figure.axes
    assert axes.get_xscale() == "log" and "box" in axes.get_xlabel()
    assert {text.get_text() for text in axes.texts} == {"a", "b"}


def test_unbeaten_points_are_smaller_in_one_measure():
    assert unbeaten([(3.0, 1.0), (1.0, 2.0), (2.0, 2.0), (4.0, 0.5), (5.0, 9.0)]) == [
        (1, 2),
        (3, 1),
        (4, 0.5),
    ]

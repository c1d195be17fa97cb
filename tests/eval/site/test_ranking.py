"""Rankings: equal printed numbers share a rank, methods without means follow, kinds of handles stay apart."""

from eval_rows import frame, lost, row

from eval.publish.summary import make_table
from eval.site.ranking import rankings


def near(name, truth, case="a", **changes):
    return row(name, case, task__checksum=case, metric__truth_distance=truth, **changes)


def test_equal_numbers_share_a_rank_and_methods_without_means_follow():
    rows = frame(
        near("slow", 1.004), near("best", 0.5), near("fast", 1.001), near("far", 3.0), lost("none", "a")
    )
    (ranking,) = rankings(make_table(rows, title="t"), {"best": 12.345})
    assert ranking.labels[:3] == ["rank", "method", "truth (%)"] and ranking.labels[-1] == "time (s)"
    places = [(texts[0], texts[1], texts[2], texts[-1]) for _, texts in ranking.lines]
    assert places[0] == ("1", "best", "0.50", "12.3") and places[3] == ("4", "far", "3.00", "-")
    assert {text[:3] for text in places[1:3]} == {("2 =", "fast", "1.00"), ("2 =", "slow", "1.00")}
    assert places[4] == ("-", "none", "failed", "-")
    assert len(ranking.first(1)) == 1 and len(ranking.first(2)) == len(ranking.first(3)) == 3


def test_without_ground_truth_edges_rank_and_without_times_there_is_no_column():
    rows = frame(row("a", metric__edge=2.0), row("b", metric__edge=1.0))
    (ranking,) = rankings(make_table(rows, title="t"), {})
    assert ranking.labels[2] == "EL (%)" and "time (s)" not in ranking.labels
    assert [texts[1] for _, texts in ranking.lines] == ["b", "a"]


def test_each_kind_of_handles_has_a_ranking():
    values = {("a", "points"): 1.0, ("b", "points"): 2.0, ("a", "regions"): 9.0, ("b", "regions"): 3.0}
    rows = [near(name, far, kind, task__meta__handles=kind) for (name, kind), far in values.items()]
    found = rankings(make_table(frame(*rows), title="t"), {})
    orders = {one.title: [texts[1] for _, texts in one.lines] for one in found}
    assert orders == {"handles: points": ["a", "b"], "handles: regions": ["b", "a"]}

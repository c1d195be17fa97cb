"""Rankings by each column: shared ranks, methods without means, kinds of handles, and refused mixtures."""

import pytest
from eval_rows import frame, lost, row

from eval.publish.summary import make_table
from eval.rows.frame import write_csv
from eval.site import pages
from eval.site.pages import contests_of, write_site
from eval.site.ranking import TIME, rankings
from eval.site.submission import Submission
from eval.site.tracks import Track
from sshade.errors import InputError

#: Differences between subjects.
NOISE = (0.0, 0.2, -0.1, 0.1)


def near(name, truth, *, noise=1.0, kind="", **changes):
    """Return rows of a method on four subjects, with distances to the ground truth around `truth`."""
    return [
        row(
            name,
            f"bodies/subject_{k}/pose_1{kind}",
            task__meta__subject=k,
            task__meta__handles=kind or None,
            metric__truth_distance=truth + noise * own,
            **changes,
        )
        for k, own in enumerate(NOISE)
    ]


def ranking_of(*rows, seconds=()):
    return rankings(make_table(frame(*(r for own in rows for r in own)), title="t"), dict(seconds))


def test_methods_that_cannot_be_told_apart_share_a_rank_and_methods_without_means_follow():
    rows = [near("slow", 1.001, noise=-0.5), near("best", 0.5), near("fast", 1.01), near("far", 3.0)]
    found = ranking_of(*rows, [lost("none", "bodies/subject_0/pose_1")], seconds={"best": 12.345})
    (ranking,) = found["truth (%)"]
    labels = ["rank", "method", "truth (%)", "difference to best", "volume (%)", "EL (%)", TIME]
    assert ranking.labels == labels
    places = [(texts[0], texts[1], texts[2], texts[-1]) for _, texts in ranking.lines]
    assert places[0] == ("1", "best", "0.55", "12.3") and places[3] == ("4", "far", "3.05", "-")
    assert [text[:3] for text in places[1:3]] == [("2 =", "slow", "0.98"), ("2 =", "fast", "1.06")]
    assert places[4] == ("-", "none", "failed", "-")
    assert [texts[3] for _, texts in ranking.lines] == [
        "-", "+0.43 [+0.12, +0.73]", "+0.51 [+0.51, +0.51]", "+2.50 [+2.50, +2.50]", "-"
    ]  # fmt: skip
    assert len(ranking.first(1)) == 1 and len(ranking.first(2)) == len(ranking.first(3)) == 3


def test_readers_choose_the_column_that_ranks():
    found = ranking_of(near("a", 1.0, metric__edge=2.0), near("b", 2.0, metric__edge=1.0), seconds={"b": 9})
    assert list(found) == ["truth (%)", "EL (%)", "volume (%)", "area (%)", "FA (deg)", TIME]
    orders = {by: [texts[:2] for _, texts in one.lines] for by, (one,) in found.items()}
    assert orders["truth (%)"] == [["1", "a"], ["2", "b"]] and orders["EL (%)"] == [["1", "b"], ["2", "a"]]
    assert orders["volume (%)"] == [["1 =", "a"], ["1 =", "b"]]
    assert orders[TIME] == [["-", "b"]] and "one case" in found[TIME][0].note


def test_two_subjects_are_sorted_without_ranks():
    found = ranking_of(near("a", 2.0)[:2], near("b", 1.0)[:2], near("c", 3.0)[:2])
    (ranking,) = found["truth (%)"]
    assert [texts[:2] for _, texts in ranking.lines] == [["-", "b"], ["-", "a"], ["-", "c"]]
    assert "No ranks" in ranking.note and [texts[1] for texts in ranking.first(2)] == ["b", "a"]


def test_without_ground_truth_edges_rank_and_without_times_there_is_no_column():
    found = ranking_of(*([r | {"metric.truth_distance": None} for r in near(name, 1.0)] for name in "ab"))
    assert next(iter(found)) == "EL (%)" and TIME not in found


def test_each_kind_of_handles_has_a_ranking():
    values = {("a", "points"): 1.0, ("b", "points"): 2.0, ("a", "regions"): 9.0, ("b", "regions"): 3.0}
    found = ranking_of(*(near(name, far, kind=kind) for (name, kind), far in values.items()))
    orders = {one.title: [texts[1] for _, texts in one.lines] for one in found["truth (%)"]}
    assert orders == {"handles: points": ["a", "b"], "handles: regions": ["b", "a"]}


TRACK = Track("tiny", "Tiny", "Four bodies.", None)


@pytest.fixture(autouse=True)
def _held_out(monkeypatch):
    monkeypatch.setattr(pages, "split_of", lambda task: "held_out")


def handed_in(rows, track="tiny"):
    name = rows[0]["method.name"]
    facts = {"name": name, "track": track, "authors": "A", "code": "https://example.org"}
    return {name: Submission(facts, "", rows, 0)}


def ours(**changes):
    return frame(*near("a", 1.0, **changes), *near("b", 2.0, **changes))


def methods_of(contests):
    return {own.track.name: sorted(set(own.rows["method.name"])) for own in contests}


def test_a_submission_joins_the_track_that_it_names_only():
    entered = handed_in(near("mine", 3.0, env__version__code="another"))
    assert methods_of(contests_of(TRACK, ours(), entered)) == {"tiny": ["a", "b", "mine"]}
    entered = handed_in(near("mine", 3.0), track="other")
    assert methods_of(contests_of(TRACK, ours(), entered)) == {"tiny": ["a", "b"]}


def test_cases_of_two_tracks_are_refused_in_one_ranking():
    """The tracks of large and small bodies have tasks of the same names."""
    mixed = frame(*near("a", 1.0, task__checksum="large"), *near("b", 2.0, task__checksum="small"))
    words = "2 tasks that are called bodies/subject_0/pose_1, of several tracks"
    with pytest.raises(InputError, match=words):
        contests_of(TRACK, mixed, {})


def test_another_version_of_the_metrics_has_rankings_and_a_page_of_its_own(tmp_path):
    new = {"env__version__metrics": "0123456789abcdef"}
    entered = handed_in(near("new", 0.1, **new)) | handed_in(near("other", 0.2, **new))
    found = contests_of(TRACK, ours(), entered | handed_in(near("same", 3.0)))
    assert methods_of(found) == {"tiny": ["a", "b", "same"], "tiny_01234567": ["new", "other"]}
    write_site(tmp_path, found, entered)
    assert "method_new.html" not in (tmp_path / "tiny.html").read_text().partition("<h2>")[2]
    assert "version 01234567 of the metrics" in (tmp_path / "tiny_01234567.html").read_text()
    text = (tmp_path / "tiny.html").read_text()
    assert '<b title="best">1.05</b>' in text and '<u title="second best">2.05</u>' in text
    assert '<i title="may be zero">+0.00 [+0.00, +0.00]</i>' in text


def test_a_click_shows_the_ranking_by_another_column(tmp_path, browser):
    write_site(tmp_path, contests_of(TRACK, ours(), {}), {})
    page = browser.new_page()
    page.goto((tmp_path / "tiny.html").as_uri())
    shown = page.locator(".rankings:visible th:nth-child(3)")
    assert shown.all_inner_texts()[0] == "truth (%)"
    page.get_by_text("area (%)", exact=True).first.click()
    assert shown.all_inner_texts()[0] == "area (%)"
    page.keyboard.press("ArrowLeft")
    assert shown.all_inner_texts()[0] == "volume (%)"
    page.close()


def test_several_versions_of_the_projects_rows_are_refused():
    with pytest.raises(InputError, match="2 versions of the code"):
        contests_of(TRACK, frame(*near("a", 1.0), *near("b", 2.0, env__version__metrics="other")), {})
    mixed = near("a", 1.0)
    mixed[0]["env.version.code"] = "other"
    with pytest.raises(InputError, match="2 versions of the code"):
        contests_of(TRACK, frame(*mixed), {})


@pytest.mark.parametrize("differs", ("env.machine", "env.version.code", "task.checksum"))
def test_times_of_two_machines_versions_or_cases_are_refused(tmp_path, differs):
    facts = {"kept": True, "round": 1, "threads": 1, "env.machine_id": "1", "seconds.total": 3.0}
    timed = [row(name, "x", method__hash=name) | facts for name in "ab"]
    timed[1][differs] = "another"
    write_csv(tmp_path / "timing" / "speed.csv", frame(*timed))
    (own,) = contests_of(TRACK._replace(timing="speed"), ours(), {})
    with pytest.raises(InputError, match=f"the times differ in {differs}"):
        write_site(tmp_path / "out", [own], {}, results=tmp_path)
    assert not (tmp_path / "out" / "tiny.html").exists()

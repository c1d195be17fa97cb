"""What drives the steps: records that outlast an interruption, and the page made of them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.full import health
from tests.full.health import FOLDERS, by_package
from tests.full.page import write_page
from tests.full.record import ROOT, Record, fill, load
from tests.full.steps import Step, steps


def counting(figures, *, until, stop=None):
    """Parts of one each."""
    for count in range(figures.get("count", 0) + 1, until + 1):
        if count == stop:
            raise KeyboardInterrupt
        yield {"count": count, "failures": []}


def test_an_interrupted_step_goes_on_from_its_last_part(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        fill(load("count", tmp_path), counting({}, until=5, stop=4), tmp_path)
    half = load("count", tmp_path)
    assert half.figures["count"] == 3 and not half.complete and not half.passed
    fill(half, counting(half.figures, until=5), tmp_path)
    done = load("count", tmp_path)
    assert done.figures["count"] == 5 and done.passed
    assert done.seconds > 0 and done.date and done.machine and done.versions["numpy"]
    assert len(done.commits) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["count.json"]


def test_a_failure_ends_a_step_that_is_then_not_complete(tmp_path):
    record = Record("bad")
    fill(record, iter([{"failures": ["one"]}, {"failures": []}]), tmp_path)
    assert not record.complete and json.loads((tmp_path / "bad.json").read_text())["figures"]["failures"] == [
        "one"
    ]


def test_the_page_tells_what_passed_what_failed_and_what_is_not_done(tmp_path):
    step = Step("counting", counting, "{count} counted")
    figures = {
        "shares": {"sshade": 97.25},
        "low": {"sshade/show.py": 71.0},
        "count": 9,
        "failures": [],
    }
    done = {
        "good": (step, Record("good", {"count": 1234567, "failures": []}, True, 60.0, ["abc"], "2026-01-01")),
        "bad": (step, Record("bad", {"failures": ["it broke"]}, False, 1.0, ["abc"], "2026-01-01")),
        "later": (step, Record("later")),
        "half": (step, Record("half", {"count": 1, "failures": []}, False, 1.0, ["abc"], "2026-01-01")),
        "coverage": (step, Record("coverage", figures, True, 600.0, ["abc", "def+"], "2026-01-02")),
    }
    half = dict(done, coverage=(step, Record("coverage", {"count": 1, "failures": []}, False)))
    page = tmp_path / "page.md"
    assert write_page(half, page)[-1] == "coverage is not done" and "sshade" not in page.read_text()
    assert write_page(done, page) == ["bad failed: it broke", "later is not done", "half is not done"]
    text = page.read_text()
    assert "| counting | 1,234,567 counted | 60 s | 2026-01-01 | abc |" in text
    assert "| counting | **failed** | 1 s |" in text
    assert "| counting | not done | 0 s |" in text and "| counting | not done yet: 1 counted | 1 s |" in text
    assert "| counting | 9 counted | 10 min | 2026-01-02 | abc, def+ |" in text
    assert "| sshade | 97.2 % |" in text and "sshade/show.py (71 %)" in text


def test_a_small_share_of_every_step_has_the_figures_that_its_line_names():
    """The steps themselves: those that take seconds are run."""
    small = steps(1e-9)
    for name in ("cases", "fuzz_native", "kills_build"):
        *_, figures = small[name].parts({})
        assert figures["failures"] == []
        assert "{" not in small[name].told.format(**figures)
    assert figures["kills"] == 1


def test_coverage_goes_on_after_a_failure_with_the_folder_that_failed(tmp_path, monkeypatch):
    asked, failing = [], ["b"]

    def tests_of(arguments, **_):
        asked.append(arguments[0])
        failures = [f"FAILED {name}" for name in failing if arguments[0] == f"tests/{name}"]
        return {"passed": 7, "warnings": 1}, failures

    monkeypatch.setattr(health, "DATA", tmp_path / "data")
    monkeypatch.setattr(health, "FOLDERS", ("a", "b"))
    monkeypatch.setattr(health, "_pytest", tests_of)
    monkeypatch.setattr(health, "_lines", lambda place: {"least": 95.0, "failures": []})
    *_, stopped = health.coverage({})
    assert stopped["failures"] == ["FAILED b"] and stopped["folders"] == ["a"]
    failing.clear()
    *_, figures = health.coverage(stopped)
    assert asked == ["tests/a", "tests/b", "tests/b"]
    assert figures["tests"] == 14 and figures["warnings"] == 2 and figures["failures"] == []


def test_coverage_leaves_no_folder_of_tests_out():
    assert sorted(FOLDERS) == sorted({path.parent.name for path in Path(ROOT, "tests").glob("*/test_*.py")})


def test_coverage_is_counted_by_package():
    def lines(run, count):
        return {"summary": {"covered_lines": run, "num_statements": count}}

    files = {"sshade/a.py": lines(9, 10), "sshade/b/c.py": lines(1, 10), "eval/d.py": lines(85, 100)}
    files["eval/__init__.py"] = lines(0, 0)
    shares, low = by_package(files)
    assert shares == {"sshade": 50.0, "eval": 85.0}
    assert low == {"sshade/b/c.py": 10.0}

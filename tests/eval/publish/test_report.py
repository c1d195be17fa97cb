"""Without runs, a report has its tables and says what is missing; the record has the words of its parts."""

from pathlib import Path

from eval_rows import frame, lost, row

from eval.main import call
from eval.publish.report import write_page
from eval.rows.collect import Experiment
from sshade.core.progress import silent


def test_without_runs_the_tables_stand_and_the_gap_is_told(tiny, here):
    assert call("report", [str(tiny), "-o", "r.html"]) == 0
    text = (here / "r.html").read_text(encoding="utf-8")
    assert text.count("No stored vertices of arap, learned, stretching in ") == 2
    assert "<img" not in text


def test_no_part_of_a_report_takes_names_and_texts_as_markup():
    told = {"method__note": "<x5>", "method__start": "<x5>", "metric__truth_distance": 2.0}
    rows = [row(name, f"<x5>{k}", **told) for name in ("a", "b<x5>") for k in range(5)]
    rows.append(lost("none", "<x5>0", reason="<x5>"))
    page = write_page([Experiment("<x5>", frame(*rows), Path())], cases=[], progress=silent)
    assert "difference to" in page and "<x5>" not in page

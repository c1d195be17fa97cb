"""Without runs, a report has its tables and says what is missing; the record has the words of its parts."""

from eval.main import call


def test_without_runs_the_tables_stand_and_the_gap_is_told(tiny, here):
    assert call("report", [str(tiny), "-o", "r.html"]) == 0
    text = (here / "r.html").read_text(encoding="utf-8")
    assert text.count("No stored vertices of arap, learned, stretching in ") == 2
    assert "<img" not in text and "five &lt;iterations&gt; &amp; no more" in text

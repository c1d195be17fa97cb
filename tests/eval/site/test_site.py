"""The pages of the leaderboard show the contents of the rows, every link works, and nothing is fetched."""

import base64
import re
from html import unescape

import pytest

from eval.main import main
from eval.rows.files import PUBLISHED
from eval.rows.frame import distinct, read_csv, to_frame
from eval.rows.store import VALID, read_row, run_folders
from eval.site import pages
from eval.site.pages import contests_of, write_site
from eval.site.submission import Submission
from eval.site.tracks import Track, published, read_tracks

TRACK = Track("tiny", "Tiny <spheres>", "Two bumpy spheres.", None)
LINK = re.compile(r'href="([^"]+)"')


@pytest.fixture
def rows(tiny_runs, monkeypatch):
    monkeypatch.setattr(pages, "split_of", lambda task: "held_out")
    return [read_row(folder) for folder in run_folders(tiny_runs)]


@pytest.fixture
def site(rows, tmp_path):
    """Write the pages with one submitted method; return their folder."""
    theirs = [row for row in rows if row["method.name"] == "stretching"]
    ours = [row for row in rows if row["method.name"] != "stretching"]
    facts = {"name": "stretching", "track": "tiny", "authors": "A & B", "code": "https://example.org/code"}
    handed_in = {"stretching": Submission(facts, "", theirs, 0)}
    write_site(tmp_path, contests_of(TRACK, to_frame(ours), handed_in), handed_in)
    return tmp_path


def test_every_link_leads_to_a_page_or_a_file(site):
    html = {path.name: path.read_text() for path in site.glob("*.html")}
    methods = {"arap", "learned", "stretching", "failing", "missing"}
    assert set(html) == {"index.html", "tiny.html", *(f"method_{name}.html" for name in methods)}
    for text in html.values():
        links = {link for link in LINK.findall(text) if not link.startswith("https://")}
        assert links and all((site / link).is_file() for link in links)
        assert "<script" not in text and "Tiny &lt;spheres&gt;" in text


def test_a_track_has_its_numbers_and_its_rows_to_download(site, rows):
    text = (site / "tiny.html").read_text()
    down = read_csv(site / "tiny.csv")
    assert sorted(down["key"]) == sorted(row["key"] for row in rows)
    stretching = [row["metric.edge"] for row in rows if row["method.name"] == "stretching"]
    assert f">{sum(stretching) / 2:.2f}<" in re.sub(r"</?[bu][^>]*>", "", text)


def test_a_method_has_its_cases_failures_and_where_it_is_from(site, rows):
    failing = unescape((site / "method_failing.html").read_text())
    (reason,) = {row["reason"] for row in rows if row["method.name"] == "failing"}
    assert failing.count(reason) == 2 and "bumpy_10" in failing
    handed_in = unescape((site / "method_stretching.html").read_text())
    assert "A & B" in handed_in and 'href="https://example.org/code"' in handed_in
    assert "factor: 1.5" in handed_in and "A & B" not in unescape((site / "method_arap.html").read_text())


def test_a_method_has_its_configuration_on_each_track(rows, tmp_path):
    (ours,) = contests_of(TRACK, to_frame(rows), {})
    other = [row | {"method.hash": "h2", "method.factor": 2.5} for row in rows]
    (theirs,) = contests_of(TRACK._replace(name="other", title="Others"), to_frame(other), {})
    write_site(tmp_path, [ours, ours._replace(track=theirs.track), theirs], {})
    text = unescape((tmp_path / "method_stretching.html").read_text())
    factors = re.findall(r"^(?:<pre>)?# (?!conf)(.*)|^factor: (.*)", text, re.MULTILINE)
    assert factors == [("Tiny <spheres>; Others", ""), ("", "1.5"), ("Others", ""), ("", "2.5")]


def test_the_projects_own_leaderboard(tmp_path, capsys):
    assert main(["site", "-o", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    for name, track in read_tracks().items():
        assert (f"left out: {name}, which has no published rows\n" in told) != track.path.is_file()
        if not track.path.is_file():
            assert not (tmp_path / "out" / f"{name}.html").exists()
            continue
        text = (tmp_path / "out" / f"{name}.html").read_text()
        rows = published(track)
        assert all(f"method_{method}.html" in text for method in set(rows["method.name"]))
        assert ("against time" in text) == (track.timing is not None)
        picture = PUBLISHED / "figures" / f"{name}.png"
        shown = picture.is_file() and base64.b64encode(picture.read_bytes()).decode() in text
        assert shown == picture.is_file()
        times = [] if track.timing is None else read_csv(f"results/timing/{track.timing}.csv")["env.machine"]
        for method in {"fast", "fine"} & set(rows["method.name"]):
            own = unescape((tmp_path / "out" / f"method_{method}.html").read_text())
            assert all(f"Machine: {machine}" in own for machine in set(times))
        down = read_csv(tmp_path / "out" / f"{name}.csv")
        assert set(down["status"]) <= {*VALID, "missing", "failed", "skipped"}
        assert ("single points" in track.text) == (len(distinct(down, "task.meta.handles")) > 1)

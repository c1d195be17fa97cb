"""The report contains everything that the rows say; nothing is fetched, and no method runs."""

import json
import re
from html import unescape

import numpy as np
import pytest
from eval_rows import frame, lost, row

from eval.main import call
from eval.publish.report import headline
from eval.publish.summary import make_table
from eval.rows.frame import read_csv


def plain(html: str) -> str:
    """Return the text of a part of a page as one line."""
    return " ".join(unescape(re.sub("<[^>]*>", " ", html)).split())


class Page:
    """A page with its tables as lists of rows of texts, its pictures by name, and texts of its elements."""

    def __init__(self, text: str) -> None:
        self.text, self.tables, self.images = text, [], {}
        for table in re.findall("<table.*?</table>", text, re.S):
            rows = re.findall("<tr>.*?</tr>", table, re.S)
            self.tables.append([[plain(cell) for cell in re.findall("<t[hd].*?</t[hd]>", r)] for r in rows])
        for source, name in re.findall('<img src="([^"]*)" alt="([^"]*)"', text):
            self.images.setdefault(name, []).append(source)

    def told(self, tag: str, kind: str = "") -> str:
        """Return the text of all elements with a tag, and with the class `kind` if it is given."""
        begin = f'<{tag} class="{kind}">' if kind else f"<{tag}>"
        return plain(" ".join(re.findall(f"{begin}.*?</{tag}>", self.text, re.S)))


@pytest.fixture(scope="module")
def page(tiny_report):
    return Page(tiny_report.read_text(encoding="utf-8"))


def test_tables_of_the_experiment_and_of_each_case(page, tiny):
    rows = read_csv(tiny)
    numbers = rows.set_index(["method.name", "task.name"])["metric.volume"]
    whole = next(table for table in page.tables if table[0][:2] == ["method", "runs"])
    lines = {line[0]: line[1:] for line in whole[1:]}
    assert lines["failing"][:2] == ["0/2", "failed"] and lines["missing"][:2] == ["0/2", "skipped"]
    assert lines["arap"][:2] == ["2", f"{numbers['arap'].astype(float).mean():.2f}"]
    assert "arap: five <iterations> & no more" in page.told("ul", "notes") and "<iterations>" not in page.text
    of_case = page.tables[1]
    assert [line[0] for line in of_case] == ["method", "arap", "learned", "stretching"]
    assert of_case[1][1] == f"{numbers['arap', 'bumpy_10']:.2f}"


@pytest.mark.parametrize(
    ("truths", "told", "bold"),
    [
        ([2.0] * 9, "", "<b>2.00</b>"),
        ([2.0, 6.0] * 4, "; the cases cannot tell it from a", "<b>4.00</b>"),
        ([2.0], "; the cases cannot tell it from the other methods", "2.00"),
    ],
)
def test_the_headline_names_the_nearest_method_unless_the_cases_cannot_tell(page, truths, told, bold):
    def runs(method, truths, seconds):
        changes = {"env__jobs": 2, "metric__volume": 1.0, "seconds__total": seconds}
        return [row(method, f"t/{i}", metric__truth_distance=x, **changes) for i, x in enumerate(truths)]

    others = [*runs("a", [4.2] * len(truths), 20.0), *runs("z", [99.0] * len(truths), 20.0), lost("c", "t/0")]
    rows = frame(*runs("b<", truths, 0.25), *others)
    found = headline(make_table(rows, title="t"), rows)
    mean = np.mean(truths)
    assert found["sentence"] == (
        f"Smallest mean distance to the true pose: b< ({mean:.2f} %){told}. Shortest mean time: b< (0.25 s)."
    )
    assert found["body"][1][0] == "b&lt;" and found["body"][1][2] == bold and "2 at once" in found["note"]
    # Without a true pose, nothing is said of it.
    assert page.tables[0][0] == ["method", "volume (%)", "EL (%)", "crossings", "time (s)"]


def test_every_case_has_pictures(page):
    for name in ("rest", "arap", "learned", "stretching"):  # plain in both cases, and results in colours
        images = page.images[name]
        assert len(images) == (2 if name == "rest" else 4) and images[0].startswith("data:image/webp")
    assert "failing" not in page.images
    assert "time against the distance to the true pose" not in page.images  # there is no true pose


def test_failures_have_their_reasons(page):
    failures = [line for table in page.tables for line in table if line[1:2] == ["bumpy_40"]]
    torch = "ImportError: torch is not installed; install the extra torch"
    assert failures == [
        ["failing", "bumpy_40", "0", "failed", "ArithmeticError: this method always fails"],
        ["missing", "bumpy_40", "0", "skipped", torch],
    ]


def test_the_view_holds_every_shape(page):
    cases = json.loads(re.search(r'id="turn-cases"[^>]*>(.*?)</script>', page.text, re.S)[1])
    assert [case["name"] for case in cases["cases"]] == ["bumpy_10", "bumpy_40"]
    (top,) = {case["top"] for case in cases["cases"]}  # one scale, which is printed once
    assert page.text.count(f'<span class="ramp"></span><span>{top:.2g}</span>') == 1 and top > 10
    for case in cases["cases"]:
        assert case["camera"] == {"towards": [1, 0, 0.2], "up": [0, 0, 1]}
        assert (case["first"], case["beside"]) == ("learned", "rest")  # the nearest one beside what is known
        assert [shape["name"] for shape in case["shapes"]] == ["rest", "arap", "learned", "stretching"]


def test_without_runs_the_tables_stand_and_the_gap_is_told(tiny, page, here):
    assert call("report", [str(tiny), "-o", "r.html"]) == 0
    without = Page((here / "r.html").read_text(encoding="utf-8"))
    assert without.tables == page.tables and "rest" not in without.images
    assert without.told("p", "warning").count("No stored vertices of arap, learned, stretching in ") == 2

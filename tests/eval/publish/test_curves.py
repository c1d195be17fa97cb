"""Curves over the size of the mesh."""

import pytest
from eval_rows import frame, row

from eval.main import call
from eval.publish.curves import curves
from eval.rows.frame import write_csv
from sshade.errors import InputError


def sized(name, vertices, volume, task="t1", status="ok"):
    facts = {"method__samplings": vertices // 1000, "metric__area": 1.0}
    return row(name, task, task__vertices=vertices, metric__volume=volume, status=status, **facts)


@pytest.fixture
def rows():
    return frame(
        sized("b-10000", 10010, 5.0),
        sized("arap-10000", 9990, 7.0),
        sized("arap-2000", 2010, 1.0),
        sized("arap-2000", 2030, 2.0, task="t2"),
        sized("arap-2000", 2020, None, task="t3"),
        sized("arap-500", 510, 9.0, status="failed"),
        sized("paper", 510, 9.0),
    )


def test_means_by_method_and_size(rows):
    assert curves(rows) == {"arap": [(2020, 1.5), (9990, 7.0)], "b": [(10010, 5.0)]}
    assert curves(rows, "area")["arap"][0] == (2020, 1.0)


def test_another_column_can_be_the_size(rows):
    assert curves(rows, over="method.samplings") == {"arap": [(2, 1.5), (9, 7.0)], "b": [(10, 5.0)]}
    with pytest.raises(InputError, match="has the metric volume and a number in task.name"):
        curves(rows, over="task.name")


def test_command_draws_a_panel_a_metric(rows, tmp_path):
    pytest.importorskip("matplotlib")
    write_csv(tmp_path / "r.csv", rows)
    options = ["--metric", "volume", "area", "--over", "method.samplings", "-o", str(tmp_path / "c.svg")]
    assert call("curves", [str(tmp_path / "r.csv"), *options]) == 0
    text = (tmp_path / "c.svg").read_text()
    for words in ("volume (%)", "area (%)", "samplings", "arap"):
        assert f"<!-- {words} -->" in text

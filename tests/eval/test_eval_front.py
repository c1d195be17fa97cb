from __future__ import annotations

import pytest

from eval.main import call
from eval.publish.front import front
from eval.rows.store import write_csv
from sshade.errors import InputError


def row(name: str, case: str = "a", *, volume: float = 1.0, weight: float | None = None, **changes):
    values = {"method.name": name, "task.name": case, "task.checksum": case, "seed": 0, "status": "ok"}
    values |= {"metric.volume": volume, "metric.edge": 2 * volume, "metric.angle": 3 * volume, "reason": ""}
    values |= {"method.hash": name, "date": "2026-01-01", "key": f"{name} {case}", "env.machine": "box"}
    values |= {"method.volume": weight} if weight is not None else {}
    return values | changes


def test_weights_make_a_curve_and_other_methods_points():
    rows = [
        row("fine-inf", volume=0.0, weight=float("inf")),
        row("fine-0.0", volume=4.0, weight=0.0),
        row("fine-0.1", volume=2.0, weight=0.1),
        row("fine", volume=3.0, weight=0.05),  # by the plain name
        row("arap", volume=9.0),
        row("accelerated-2", volume=7.0),  # a number, but no weight
        row("identity", volume=5.0),
    ]
    points = front(rows)
    assert points["fine"] == [(4.0, 8.0, 12.0), (3.0, 6.0, 9.0), (2.0, 4.0, 6.0), (0.0, 0.0, 0.0)]
    assert points["arap"] == [(9.0, 18.0, 27.0)] and points["accelerated-2"] == [(7.0, 14.0, 21.0)]
    assert "identity" not in points


def test_means_are_over_the_cases_that_all_have():
    rows = [row("fine-1", "a", volume=1.0, weight=1), row("fine-1", "b", volume=3.0, weight=1)]
    rows += [row("arap", case, volume=volume) for case, volume in (("a", 5.0), ("b", 7.0), ("c", 100.0))]
    points = front([*rows, row("arap", "d", status="failed", **{"metric.volume": None})])
    assert points == {"fine": [(2.0, 4.0, 6.0)], "arap": [(6.0, 12.0, 18.0)]}
    with pytest.raises(InputError, match="no case in common"):
        front([*rows, row("other", "z")])
    with pytest.raises(InputError, match="no case in common"):
        front([])


def test_command_draws_rows_of_several_files(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    write_csv(
        tmp_path / "front.csv", [row("fine-0.0", weight=0.0), row("fine-inf", weight=".inf", volume=0.5)]
    )
    write_csv(tmp_path / "others.csv", [row("arap", volume=2.0)])
    paths = [str(tmp_path / f"{name}.csv") for name in ("front", "others")]
    pictures = [tmp_path / f"{i}.svg" for i in (1, 2)]
    for picture in pictures:
        assert call("front", [*paths, "-o", str(picture)]) == 0
    assert pictures[0].read_bytes() == pictures[1].read_bytes()
    text = pictures[0].read_text()
    assert text.count("<!-- fine -->") == text.count("<!-- arap -->") == 1
    assert str(pictures[1]) in capsys.readouterr().out
    assert call("front", [*paths, "-o", str(pictures[0]), "--leave-out", "arap"]) == 0
    assert "<!-- arap -->" not in pictures[0].read_text()

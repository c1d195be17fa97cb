"""Committed bands of quality: what leaves them, and what they are suggested from."""

from __future__ import annotations

from eval_rows import frame, lost, row

from eval.main import call
from eval.rows.bands import out_of_band, read_bands, suggest
from eval.rows.frame import write_csv


def test_bands():
    bands = {"a": {"t1": {"metric.volume": [0.5, 1.5], "metric.area": [0, 1]}}}
    assert out_of_band(row("a", metric__area=1.0), bands) == []
    assert out_of_band(row("a"), bands) == ["metric.area is 2.0, not in [0, 1]"]
    assert out_of_band(row("a", metric__volume=None, metric__area=1.0), bands) == [
        "metric.volume is None, not in [0.5, 1.5]"
    ]
    assert out_of_band(lost("a", reason="no"), bands) == ["status failed: no"]
    assert out_of_band(lost("a", status="skipped"), bands) == []
    assert out_of_band(row("b"), bands) == ["no band for b on t1"]
    assert out_of_band(row("a", "t2"), bands) == ["no band for a on t2"]


def test_suggested_bands_hold_their_rows_and_not_much_else():
    rows = [row("a"), row("a", "t2", metric__volume=None), lost("b")]
    bands = suggest(rows)
    assert set(bands) == {"a"} and "metric.volume" not in bands["a"]["t2"]
    assert bands["a"]["t1"]["metric.area"] == [1.6, 2.5]
    assert bands["a"]["t1"]["metric.handle"] == [0.0, 0.05]
    assert out_of_band(rows[0], bands) == []
    assert out_of_band(row("a", metric__area=2.6), bands) != []


def test_command(tmp_path, capsys):
    path, task = str(tmp_path / "r.csv"), next(iter(read_bands("ci")["arap"]))
    write_csv(path, frame(row("arap", task, metric__volume=1e9)))
    assert call("check", [path]) == 1
    assert "metric.volume is 1000000000.0" in capsys.readouterr().out
    assert call("check", [path, "--suggest"]) == 0
    assert "metric.volume: [800000000.0, 1250000000.0]" in capsys.readouterr().out

"""Committed bands of quality: rows outside a band, and bands suggested from rows."""

import pytest
from eval_rows import frame, lost, row

from eval.main import call
from eval.rows.bands import out_of_band, read_bands, suggest
from eval.rows.frame import write_csv

CI = read_bands("ci")


def test_bands():
    bands = {"a": {"t1": {"metric.volume": [0.5, 1.5], "metric.area": [0, 1]}}}
    assert out_of_band(row("a", metric__area=1.0), bands) == []
    assert out_of_band(row("a"), bands) == ["metric.area is 2.0, not in [0, 1]"]
    lacking = row("a", metric__volume=None, metric__area=1.0)
    assert out_of_band(lacking, bands) == ["metric.volume is None, not in [0.5, 1.5]"]
    assert out_of_band(lost("a", reason="no"), bands) == ["status failed: no"]
    assert out_of_band(lost("a", status="skipped"), bands) == []
    assert out_of_band(row("b"), bands) == ["no band for b on t1"]
    assert out_of_band(row("a", "t2"), bands) == ["no band for a on t2"]


def test_a_suggested_band_holds_every_seed():
    seeds = [row("a", seed=seed, metric__volume=volume) for seed, volume in enumerate((1.0, 3.0, 2.0))]
    assert suggest(seeds)["a"]["t1"]["metric.volume"] == [0.952, 3.15]
    assert not any(out_of_band(own, suggest(seeds)) for own in seeds)


def test_suggested_bands_hold_their_rows_and_not_much_else():
    rows = [row("a"), row("a", "t2", metric__volume=None), lost("b")]
    bands = suggest(rows)
    assert set(bands) == {"a"} and "metric.volume" not in bands["a"]["t2"]
    assert bands["a"]["t1"]["metric.area"] == [1.9, 2.1]
    assert bands["a"]["t1"]["metric.handle"] == [0.0, 1e-7]
    assert out_of_band(rows[0], bands) == []
    assert out_of_band(row("a", metric__area=2.11), bands) != []


@pytest.mark.parametrize(
    ("column", "value", "band"),
    [
        ("flips", 0.0, [0.0, 0.0]),
        ("flips", 8.0, [3.0, 13.0]),
        ("flips", 200.0, [160.0, 250.0]),
        ("handle", 0.0008, [0.0, 0.001]),
        ("volume", 2e-9, [0.0, 0.005]),
        ("bend_tail", 10.0, [8.0, 12.5]),
        ("distortion_max", 1e-15, [0.0, 0.001]),
    ],
)
def test_widths_of_suggested_bands(column, value, band):
    suggested = suggest([row("a", **{f"metric__{column}": value})])
    assert suggested["a"]["t1"][f"metric.{column}"] == band


@pytest.mark.parametrize("column", ["self_intersections", "flips", "collapsed"])
def test_the_promises_of_fine_are_zero_in_its_bands(column):
    for task, bands in CI["fine"].items():
        middle = {name: (low + high) / 2 for name, (low, high) in bands.items()}
        broken = row("fine", task) | middle | {f"metric.{column}": 1.0}
        assert out_of_band(broken, CI) == [f"metric.{column} is 1.0, not in [0.0, 0.0]"]


def test_command(tmp_path, capsys):
    path, task = str(tmp_path / "r.csv"), next(iter(CI["arap"]))
    write_csv(path, frame(row("arap", task, metric__volume=1e9)))
    assert call("check", [path]) == 1
    assert "metric.volume is 1000000000.0" in capsys.readouterr().out
    assert call("check", [path, "--suggest"]) == 0
    assert "metric.volume: [952000000.0, 1050000000.0]" in capsys.readouterr().out

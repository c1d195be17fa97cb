"""Charts of an experiment: their contents, and equal files from equal rows."""

import numpy as np
import pytest
from eval_rows import frame, lost, row

from eval.main import call
from eval.publish.charts import charts, convergence, distributions
from eval.rows.experiment import Experiment
from eval.rows.frame import write_csv
from eval.rows.store import run_folder, write_run


@pytest.fixture
def rows():
    return [
        row("arap", metric__volume=4.0),
        row("arap", "t2", metric__volume=8.0, peak_mib=50.0),
        row("paper", metric__volume=2.0, peak_mib=0.5),
        lost("paper", "t2"),
    ]


def test_a_distribution_shows_every_run_of_every_method(rows):
    found = distributions(frame(*rows))
    # Measures that are equal in all runs, such as the area, have no chart.
    assert set(found) == {"volume", "memory"}
    axes = found["volume"].axes[0]
    dots = [np.asarray(part.get_offsets())[:, 0].tolist() for part in axes.collections]
    assert dots == [[4.0, 8.0], [2.0]]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["arap", "paper"]
    assert axes.get_yticks().tolist() == [1, 0]
    assert axes.get_title() == "volume (%)" and axes.get_xscale() == "linear" and axes.get_xlim()[0] == 0
    medians = sorted({line.get_xdata()[0] for line in axes.lines if len(set(line.get_xdata())) == 1})
    assert 6.0 in medians and 2.0 in medians
    assert found["memory"].axes[0].get_xscale() == "log"


def test_zeros_among_orders_of_magnitude_stay_visible():
    rows = [row("a", f"t{i}", metric__volume=v) for i, v in enumerate([0.0, 0.1, 0.2, 50.0])]
    axes = distributions(frame(*rows))["volume"].axes[0]
    assert axes.get_xscale() == "symlog" and axes.get_xlim()[0] == 0
    assert axes.xaxis.get_transform().linthresh == pytest.approx(0.1)


def test_the_sizes_of_a_method_share_its_colour():
    rows = [
        row("arap-2000", task__vertices=2010, metric__volume=2.0),
        row("arap-9000", task__vertices=9020),
        row("paper-6000", task__vertices=2010),  # the mesh has 2010 vertices, not 6000
        row("paper-600", task__vertices=2010),
    ]
    axes = distributions(frame(*rows))["volume"].axes[0]
    colours = [tuple(part.get_facecolor()[0]) for part in axes.collections]
    assert colours[0] == colours[1] and len(set(colours)) == 3


def test_curves_of_the_runs_that_are_here(rows, tmp_path):
    losses = np.array([[4.0, 1.0], [2.0, 0.5], [1.0, 0.25]])
    write_run(run_folder(tmp_path, rows[0]), rows[0], curves={"loss_curve": losses})
    write_run(run_folder(tmp_path, rows[1]), rows[1], curves={"energy_curve": np.array([3.0, -1.0])})
    # The curves of an older run with the same key do not belong to the row.
    older = rows[2] | {"date": "2020"}
    write_run(run_folder(tmp_path, rows[2]), older, curves={"energy_curve": losses[:, 0]})
    found = convergence(Experiment("tiny", frame(*rows), (tmp_path,)))
    assert list(found) == ["energy_curve", "loss_curve_1", "loss_curve_2"]
    (line,) = found["loss_curve_2"].axes[0].lines
    assert line.get_xydata().tolist() == [[1, 1.0], [2, 0.5], [3, 0.25]]
    assert found["loss_curve_2"].axes[0].get_yscale() == "log"
    (line,) = found["energy_curve"].axes[0].lines
    assert line.get_label() == "arap" and found["energy_curve"].axes[0].get_yscale() == "linear"
    assert convergence(Experiment("tiny", frame(*rows), (tmp_path / "elsewhere",))) == {}


@pytest.mark.parametrize("suffix", ["svg", "pdf"])
def test_command_writes_the_same_bytes_again(rows, tmp_path, capsys, suffix):
    write_csv(tmp_path / "tiny.csv", frame(*rows))
    for out in ("one", "two"):
        arguments = [str(tmp_path / "tiny.csv"), "--format", suffix, "-o", str(tmp_path / out)]
        assert call("charts", arguments) == 0
    files = sorted(path.name for path in (tmp_path / "one" / "tiny").iterdir())
    assert files == sorted(f"{name}.{suffix}" for name in charts(Experiment("tiny", frame(*rows), ())))
    for name in files:
        one, two = ((tmp_path / out / "tiny" / name).read_bytes() for out in ("one", "two"))
        assert one == two and len(one) > 1000
    assert str(tmp_path / "one" / "tiny" / f"volume.{suffix}") in capsys.readouterr().out

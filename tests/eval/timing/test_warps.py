"""The study of warps: its maps, its mesh, and a table in which dense handles are interpolated."""

import numpy as np
import pytest

from eval.main import main
from eval.timing.warps import HELD_OUT, MAPS, ellipsoid, measure_warps, table
from tests.shapes import strip


def test_the_mesh_and_the_maps():
    mesh = ellipsoid(4)
    assert mesh.n == 10 * 4**4 + 2 and mesh.volume > 0 and mesh.topology.euler == 2
    V = ellipsoid(6).V
    grown = type(mesh)(MAPS["grow"](V), ellipsoid(6).F).volume / ellipsoid(6).volume
    assert grown == pytest.approx(1.087, abs=0.01)
    assert len(HELD_OUT) == len(MAPS) / 2
    for f in MAPS.values():  # no map folds space
        step = 1e-6 * np.eye(3)
        J = np.stack([(f(V + h) - f(V - h)) / 2e-6 for h in step], axis=2)
        assert (np.linalg.det(J) > 0).all()


def test_rows():
    rows = measure_warps(ellipsoid(4), ["fast", "never=fast warp=never", "peer/rbf"], ["grow"], [100])
    fast, never, rbf = rows
    assert fast["warped"] == 1 and fast["mean"] < rbf["mean"] < 0.1 < never["mean"]
    assert abs(fast["volume"]) < 0.1 and never["volume"] < -5
    rows = measure_warps(strip(10, 10), ["fast"], ["grow"], [20])
    assert "volume" not in rows[0] and "| n/a |" in table(rows)


def test_refused(capsys):
    assert main(["warps", "--quick", "--handles", "3"]) == 2
    assert "--handles takes numbers from 4 to" in capsys.readouterr().err
    assert main(["warps", "--quick", "--seed", "-1"]) == 2
    assert "--seed takes a whole number from 0, not -1" in capsys.readouterr().err

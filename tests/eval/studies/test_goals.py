"""Requested volumes and reached volumes, and local thickness."""

from dataclasses import replace

import numpy as np
import pytest

from eval.main import call
from eval.run.provenance import task_checksum
from eval.studies import goals
from eval.studies.thickness import local_thickness, opposite_points
from sshade import Mesh, VolumeGoal

HOSE = goals.vessel(6.0, 0.25, rings=20)


@pytest.mark.parametrize("mesh", [goals.capsule(5.0), HOSE, goals.two_rods()])
def test_shapes_are_closed_and_face_outwards(mesh):
    assert mesh.is_closed and mesh.is_oriented and mesh.is_manifold and mesh.volume > 0


def test_the_thickness_of_a_vessel_is_its_wall_and_scales():
    free = np.flatnonzero(np.abs(HOSE.face_normals[:, 2]) < 0.5)
    pairs = opposite_points(HOSE, pairs=100, faces=free)
    assert len(pairs.face) == 100 and pairs.lengths(HOSE.V, HOSE.F) == pytest.approx(0.25, rel=0.02)
    thin = local_thickness(HOSE, HOSE.V * [0.5, 0.5, 1.0], pairs)
    assert thin == {name: pytest.approx(0.5, rel=1e-3) for name in ("p5", "median", "p95")}
    assert local_thickness(HOSE, goals.bent(HOSE.V, 90.0), pairs)["p5"] == pytest.approx(1.0, rel=1e-2)


def test_half_of_the_cases_are_held_out_and_the_command_prints_both_tables(monkeypatch, capsys):
    cases = list(goals.cases())
    assert sum(case.held_out for case in cases) * 2 == len(cases)
    monkeypatch.setattr(goals, "cases", lambda: iter(cases[4:5]))
    monkeypatch.setattr(goals, "bends", lambda: iter(cases[:0]))
    assert call("goals", ["--methods", "fast"]) == 0
    out = capsys.readouterr().out
    assert "| belly | no | fast | belly | 1.300 | 1.300" in out and "Thickness" in out


def test_reached_volumes_are_ratios():
    case = goals.Case(goals.task_of("t", Mesh(HOSE.V, HOSE.F), 10.0), False, 2.0)
    assert goals.reached(case, 2.0 * HOSE.V) == {"whole": pytest.approx(8.0)}
    other = replace(case.task, volumes=[VolumeGoal(ratio=1.5)])
    assert task_checksum(other) != task_checksum(case.task)

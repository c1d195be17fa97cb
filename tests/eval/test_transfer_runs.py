"""Pose transfers as runs: their rows, their checksums, and methods for another kind of task."""

import pytest
from eval_cases import run

from eval.metrics import METRICS
from eval.run.environment import task_checksum
from sshade.mesh.mesh import Mesh
from sshade.problem.task import TransferTask
from tests.shapes import bumpy


def test_a_pose_transfer_becomes_a_row(tmp_path):
    rest = bumpy(2)
    edited = Mesh(rest.V * [1.1, 1, 1], rest.F)
    posed, truth = rest.V[:, [1, 2, 0]], edited.V[:, [1, 2, 0]]
    task = TransferTask("t", edited, rest, posed, truth=truth, meta={"edit": "wider"})
    method = {"_target_": "sshade.method.transfer.transfer", "vertices": 60, "samplings": 2}
    method["warm_up"] = {"samplings": 1}
    row = run(task, method, name="paper", root=tmp_path).row
    assert row["status"] == "ok" and row["task.meta.edit"] == "wider" and row["env.warmed_up"]
    assert not any(name.startswith(("task.handles", "task.snap", "metric.handle")) for name in row)
    # The pose is a rotation, which the frames transfer exactly.
    for name, metric in METRICS.items():
        assert "truth" not in metric.needs or row[f"metric.{name}"] == pytest.approx(0, abs=1e-9)
    assert row["seconds.total"] > 0 and row["iterations"] == 0 and row["converged"] is None
    assert run(task, method, name="paper", root=tmp_path).found


def test_the_checksum_of_a_pose_transfer_covers_all_that_a_method_reads():
    rest = bumpy(1)
    task = TransferTask("t", rest, rest, 2 * rest.V)
    same = TransferTask("other name", rest, rest, 2 * rest.V, truth=rest.V)
    assert task_checksum(task) == task_checksum(same)
    others = [
        TransferTask("t", Mesh(3 * rest.V, rest.F), rest, 2 * rest.V),
        TransferTask("t", rest, Mesh(3 * rest.V, rest.F), 2 * rest.V),
        TransferTask("t", rest, rest, 3 * rest.V),
    ]
    assert len({task_checksum(other) for other in [task, *others]}) == 4

"""Checksums of pose transfers."""

from eval.run.environment import task_checksum
from sshade.mesh.mesh import Mesh
from sshade.problem.task import TransferTask
from tests.shapes import bumpy


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

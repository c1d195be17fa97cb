"""A sequence on the command line keeps the shapes of few poses in memory."""

import weakref

from sshade.cli.main import main
from sshade.files.meshes import write_mesh
from sshade.files.task_files import write_handles
from sshade.method import sequence
from tests.shapes import bumpy, end_handles


def test_the_shapes_of_earlier_poses_are_freed(here, monkeypatch):
    body = bumpy(2)
    write_mesh("body.ply", body.V, body.F)
    poses = [f"pose_{number}.json" for number in range(4)]
    for name, step in zip(poses, (0.1, 0.15, 0.2, 0.25), strict=True):
        write_handles(name, end_handles(body.V, shift=[step, 0, 0.5 * step]))
    shapes, alive = [], []

    def watched(*given):
        for result in solved(*given):
            alive.append(sum(shape() is not None for shape in shapes))
            shapes.append(weakref.ref(result.vertices))
            yield result
            del result

    solved = sequence.solved_poses
    monkeypatch.setattr(sequence, "solved_poses", watched)
    assert main(["deform", "body.ply", *poses, "-o", "out_%d.ply", "--vertices", "60"]) == 0
    assert len(alive) == 4 and max(alive) <= 2

"""The command says what is odd about a surface and about handles."""

from pathlib import Path

import numpy as np
import pytest

from sshade import Handles
from sshade.files.meshes import write_mesh
from sshade.files.task_files import write_handles
from sshade.problem.handle_checks import astray
from tests.robustness.case import run
from tests.shapes import block, icosphere


def test_faces_inside_of_a_solid_are_hinted_at(here):
    """The faces of all cubes of a block, as a mesh of a solid has them."""
    cube = block(np.ones((1, 1, 1), dtype=bool))
    parts = [cube.V + [i, j, k] for i in range(4) for j in range(4) for k in range(4)]
    W, vertex = np.unique(np.concatenate(parts), axis=0, return_inverse=True)
    faces = np.concatenate([cube.F + k * cube.n for k in range(64)])
    write_mesh("a.ply", W, vertex.ravel()[faces])
    Path("pose.json").write_text('{"handles": [{"vertices": [0, 60]}, {"vertices": [124], "scale": 2}]}')
    code, _, err = run("sshade deform a.ply pose.json -o out.ply")
    assert code == 0 and "more than two faces meet at an edge in most of the mesh, as faces inside" in err


def test_handles_that_shrink_together_are_not_astray():
    rest = icosphere(3).V
    target = 0.01 * rest
    target[::50] += [0.03, 0, 0]  # far for the shrunk ones, and near for the size that they had
    assert len(astray(rest, target)) == 0 < len(astray(rest, 100 * target))


@pytest.mark.parametrize("method", ["fast", "interpolate"])
def test_handles_that_contradict_their_neighbours_are_named(here, method):
    body = icosphere(4)
    write_mesh("a.ply", body.V, body.F)
    ids = np.arange(0, body.n, 10)
    target = body.V[ids] + 0.3 * np.sin(2 * body.V[ids, ::-1])
    wrong = [10, 100, 200]
    for exchanged in (False, True):
        if exchanged:
            target[wrong] = target[np.roll(wrong, 1)]
        write_handles("pose.json", Handles(ids, target))
        code, _, err = run(f"sshade deform a.ply pose.json -o out.ply --method {method}")
        named = f"vertex {', '.join(map(str, ids[wrong]))}; check the order of the targets"
        told = "3 handles go far from where neighbours go" in err and named in err
        assert code == 0 and told == exchanged

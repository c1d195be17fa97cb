"""The command moves surfaces of all kinds with their handles, and tears none of them."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from sshade import Handles, Mesh
from sshade.files.meshes import write_mesh
from sshade.files.task_files import write_handles
from tests.robustness.case import run
from tests.shapes import beside, block, bumpy, double_torus, icosphere, strip
from tests.sshade.files.posing import given, whole, write_pose
from tests.write import mesh_ply

BODY = bumpy(2)
V, F = BODY.V, BODY.F
#: Accepted error of positions as a fraction of the diagonal.
NEAR = 1e-8
#: Greatest stretch of an edge. Edges count as at least a fraction of the median edge: proxies do not resolve
#: shorter edges.
STRETCH, SHORT = 2.5, 0.3


SURFACES = {
    "two holes": double_torus(cells=2),
    "cubes that share an edge": block(np.eye(2)[:, :, None], cells=3),
    "cubes that share a vertex": block(np.array([[[1, 0], [0, 0]], [[0, 0], [0, 1]]]), cells=3),
    "triangles that share a vertex": Mesh(
        np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.0], [-1, 0, 0], [-1, -1, 0]]), [[0, 1, 2], [0, 3, 4]]
    ),
    "half inside out": Mesh(V, np.where(np.arange(len(F))[:, None] < 160, F[:, ::-1], F)),
    "slivers": Mesh(strip(2, 40).V * [1e-4, 1, 1], strip(2, 40).F),
    "nested shells": beside(BODY, Mesh(0.8 * V, F), Mesh(-0.5 * V, F)),
    "huge": Mesh(1e30 * V, F),
}


@pytest.mark.parametrize("name", SURFACES)
def test_a_surface_moves_as_one_body_and_is_not_torn(here, name):
    mesh = SURFACES[name]
    Path("mesh.ply").write_bytes(mesh_ply(mesh.V, mesh.F))
    for motion in ("whole", "bend"):
        handles = given(mesh, motion, share=0.3 if mesh.n < 10 else 0.15)
        write_pose(mesh, handles)
        code, _, err = run("sshade deform mesh.ply pose.json -o posed.ply")
        assert code == 0 and "warning" not in err, err
        W, atol = trimesh.load_mesh("posed.ply", process=False).vertices, NEAR * mesh.diagonal
        if motion == "whole":
            np.testing.assert_allclose(W, whole(mesh), rtol=0, atol=atol)
        np.testing.assert_allclose(W[handles.index], handles.target, rtol=0, atol=atol)
        a, b = np.concatenate([mesh.F[:, [0, 1]], mesh.F[:, [1, 2]], mesh.F[:, [2, 0]]]).T
        before, after = (np.linalg.norm(X[a] - X[b], axis=1) for X in (mesh.V, W))
        assert (after / np.maximum(before, SHORT * np.median(before))).max() < STRETCH


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
        assert (
            code == 0 and ("3 handles go far from where neighbours go" in err and named in err) == exchanged
        )

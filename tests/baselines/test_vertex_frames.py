"""Vertex frames against igl's gradient, and the pose transfer they give."""

import igl
import numpy as np
import pytest

from baselines.vertex_frames import transfer
from sshade import Mesh, TransferTask
from sshade.proxy.triangle import FLAT
from tests.shapes import bent, family, rotation


def edit(mesh, amount=0.1):
    """A rest mesh with dents, which no rigid motion undoes."""
    return mesh.V + amount * np.sin(np.roll(mesh.V, 1, axis=1) * 5) * mesh.diagonal / 10


def moved(mesh, edited, posed):
    return transfer(TransferTask("t", Mesh(edited, mesh.F), mesh, posed)).vertices


def gradients(mesh, V, values):
    """(n, c, 3) tangential parts of area-weighted mean gradients, and (n, 3) normals, by igl and loops."""
    G = igl.grad(V, mesh.F)
    area = igl.doublearea(V, mesh.F) / 2
    faces = Mesh(V, mesh.F).face_normals
    per_face = np.stack([(G @ f).reshape(3, -1).T for f in values.T], axis=1)
    mean, normal = np.zeros((mesh.n, values.shape[1], 3)), np.zeros((mesh.n, 3))
    for v in range(mesh.n):
        at = np.flatnonzero((v == mesh.F).any(axis=1))
        normal[v] = area[at] @ faces[at]
        normal[v] /= np.linalg.norm(normal[v])
        mean[v] = np.einsum("t,tfx->fx", area[at], per_face[at]) / area[at].sum()
        mean[v] -= np.outer(mean[v] @ normal[v], normal[v])
    return mean, normal


def frames(mesh, V, values, chosen):
    """(n, 3, 3) frames of a pose for the chosen columns of values."""
    mean, z = gradients(mesh, V, values)
    y = np.cross(z, mean[np.arange(mesh.n), chosen])
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([np.cross(y, z), y, z], axis=2)


@pytest.mark.parametrize("name", family())
def test_displacements_turn_with_the_frames_of_igl_gradient(name):
    mesh = family()[name]
    values = np.column_stack([mesh.V[:, np.argmax(np.ptp(mesh.V, axis=0))], mesh.V])
    at_rest = np.linalg.norm(gradients(mesh, mesh.V, values)[0], axis=2)
    chosen = np.where(at_rest[:, 0] < FLAT, 1 + at_rest[:, 1:].argmax(axis=1), 0)
    posed = bent(mesh.V)
    rest, turned = (frames(mesh, V, values, chosen) for V in (mesh.V, posed))
    expected = posed + np.einsum("nab,ncb,nc->na", turned, rest, edit(mesh) - mesh.V)
    np.testing.assert_allclose(moved(mesh, edit(mesh), posed), expected, atol=1e-8 * mesh.diagonal)


def test_a_collapsed_ring_turns_as_its_neighbours_do(body, caplog):
    posed = body.V @ rotation(1).T
    ring = np.unique(body.F[(body.F == 7).any(axis=1)])
    posed[ring] = posed[7]
    columns = [moved(body, body.V + e, posed) - posed for e in np.eye(3)]
    assert "1 vertex has no frame" in caplog.text
    turned = np.stack(columns, axis=2)
    U, _, Vt = np.linalg.svd(turned[ring[ring != 7]].mean(axis=0))
    np.testing.assert_allclose(turned[7], U @ Vt, atol=1e-12)

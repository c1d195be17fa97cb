import numpy as np
import pytest

from sshade import InputError, Mesh
from tests.shapes import block, tetrahedron

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
FAR = np.array([[5.0, 5, 5], [6, 6, 6]])


@pytest.mark.parametrize(
    ("V", "F", "words"),
    [
        (np.zeros(9), [[0, 1, 2]], ["(n, 3)", "(9,)"]),
        (TRIANGLE, [0, 1, 2], ["(m, 3)", "(3,)"]),
        (np.concatenate([FAR, TRIANGLE]), [[2, 3, 4]], ["2 vertices belong to no face", "leaves them out"]),
        *((size * TRIANGLE, [[0, 1, 2]], ["scale it to between 1e-60 and 1e+60"]) for size in (1e61, 1e-61)),
    ],
)
def test_unusable_arrays_are_refused_with_a_remedy(V, F, words):
    with pytest.raises(InputError) as caught:
        Mesh(V, F)
    assert all(word in str(caught.value) for word in words)


def test_areas_normals_volume_and_diagonal_of_a_block_are_exact():
    mesh = block(np.ones((2, 3, 4)))
    assert mesh.area == pytest.approx(2 * (6 + 8 + 12), rel=1e-14)
    assert mesh.volume == pytest.approx(24, rel=1e-14)
    assert mesh.diagonal == pytest.approx(np.sqrt(4 + 9 + 16), rel=1e-15)
    assert np.allclose(np.abs(mesh.face_normals).sum(axis=1), 1.0)
    # Coordinates are exact to 1e-10; moments about the origin would lose 1e17 x 1e-16.
    assert Mesh(mesh.V + 1e6 / 3, mesh.F[:, ::-1]).volume == pytest.approx(-24, rel=1e-8)
    flat = Mesh(np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], np.float32), [[0, 1, 2], [0, 1, 3]])
    assert flat.V.dtype == np.float64 and flat.F.dtype == np.int64
    assert flat.face_areas.tolist() == [0.0, 0.5] and flat.face_normals.tolist() == [[0, 0, 0], [0, 0, 1]]
    a, b, c = mesh.V[mesh.F].transpose(1, 0, 2)
    assert np.allclose(mesh.face_areas[:, None] * mesh.face_normals, np.cross(b - a, c - a) / 2)


@pytest.mark.parametrize("shift", [2.0**20, -(2.0**35), 1e9 + 0.5])
@pytest.mark.parametrize("factor", [1.0, 0.37])
def test_coordinates_relative_to_the_origin_of_a_far_mesh_are_exact(shift, factor):
    mesh = tetrahedron()
    far = Mesh(factor * mesh.V + [shift, 0, -shift], mesh.F)
    relative = far.V - far.origin
    assert np.abs(relative).max() <= 8 * np.ptp(far.V, axis=0).max()
    assert far.origin[1] == 0 and np.array_equal(relative + far.origin, far.V)
    assert np.array_equal(np.diff(relative, axis=0), np.diff(far.V, axis=0))

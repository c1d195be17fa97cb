import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from sshade import Mesh
from sshade.mesh.mesh import LARGEST
from sshade.proxy.projection import Projection, project_to_fans
from sshade.proxy.sample import Sampling, proxy_mesh, sample_proxy
from tests.shapes import beside, bumpy, double_torus, jittered, rotation, shifted, strip, tube


def nearest_in_triangle(p: np.ndarray, corners: np.ndarray) -> float:
    """Return the distance to a triangle by trying its corners, its edges and its interior."""
    best = np.linalg.norm(corners - p, axis=1).min()
    for ids in ((0, 1), (1, 2), (2, 0), (0, 1, 2)):
        origin, *others = corners[list(ids)]
        basis = np.array(others) - origin
        coefficients = np.linalg.lstsq(basis.T, p - origin, rcond=None)[0]
        if coefficients.min() >= 0 and coefficients.sum() <= 1:
            best = min(best, float(np.linalg.norm(origin + coefficients @ basis - p)))
    return best


def at(proxy: Mesh, cell: list[int]) -> Sampling:
    """Return a sampling that assigns the vertices of M to the given cells."""
    return Sampling(np.arange(proxy.n), proxy.F, np.array(cell, dtype=np.int32), np.zeros(len(cell)))


def distances(V: np.ndarray, proxy: Mesh, on: Projection) -> np.ndarray:
    """Return the distances (n,) of vertices from their points on a proxy."""
    points = np.einsum("nc,ncx->nx", on.barycentric, proxy.V[proxy.F[on.face]])
    return np.linalg.norm(V - points, axis=1)


MESHES = {"tube": jittered(tube(8, 20), 0.05), "strip": jittered(strip(15, 4), 0.2)}
MESHES |= {"bumpy": bumpy(2), "double torus": double_torus()}


@pytest.fixture(scope="module", params=MESHES)
def bound(request):
    mesh = MESHES[request.param]
    result = sample_proxy(mesh, max(12, mesh.n // 8), seed=1)
    proxy = proxy_mesh(mesh, result)
    return mesh, result, proxy, project_to_fans(mesh.V, proxy, result)


def test_vertices_go_to_the_nearest_point_of_the_fan_of_their_sample(bound):
    mesh, result, proxy, projection = bound
    distance = distances(mesh.V, proxy, projection)
    for v in range(mesh.n):
        fan = np.flatnonzero((result.cell[v] == proxy.F).any(axis=1))
        assert projection.face[v] in fan
        least = min(nearest_in_triangle(mesh.V[v], proxy.V[proxy.F[t]]) for t in fan)
        assert distance[v] == pytest.approx(least, rel=1e-9, abs=1e-13 * mesh.diagonal)
    assert np.allclose(projection.barycentric.sum(axis=1), 1.0, rtol=0, atol=1e-15)
    assert projection.barycentric.min() >= -1e-15


def test_only_the_own_fan_counts_where_two_sheets_touch():
    """A vertex of the first sheet is projected onto the first sheet even if the second sheet is nearer."""
    sheet = strip(6, 6)
    proxy = beside(sheet, shifted(sheet, [0, 0, 0.1]))
    query = sheet.V[[24]] + [0.2, 0.1, 0.09]
    own = project_to_fans(query, proxy, at(proxy, [24]))
    assert distances(query, proxy, own) == pytest.approx(0.09) and own.face[0] < sheet.m


@given(
    corners=st.lists(st.lists(st.floats(-1, 1), min_size=3, max_size=3), min_size=3, max_size=3),
    p=st.lists(st.floats(-2, 2), min_size=3, max_size=3),
)
def test_any_triangle_also_flat_or_a_point(corners, p):
    assume(not 0 < np.ptp(corners, axis=0).max() < 2 / LARGEST)  # a Mesh cannot be so small
    proxy, p = Mesh(np.array(corners), [[0, 1, 2]]), np.array(p)
    projection = project_to_fans(p[None], proxy, at(proxy, [1]))
    nearest = nearest_in_triangle(p, proxy.V)
    assert distances(p[None], proxy, projection) == pytest.approx(nearest, rel=1e-7, abs=1e-7)
    assert np.isfinite(projection.barycentric).all() and projection.barycentric.min() >= -1e-12


@pytest.mark.parametrize("height", [0.0, 1e-18, 1e-14, 1e-10, 1e-6, 1e-3])
def test_slivers_lose_no_digits(height):
    # All points lie in the plane of the sliver, above its long edge: the distance is closed-form.
    V = np.array([[0.0, 0, 0], [3, 0, 0], [1, height, 0]])
    x = np.linspace(0.05, 2.95, 30)
    turn = rotation(2)
    for axes in (np.eye(3), turn):
        proxy = Mesh(V @ axes.T, [[0, 1, 2]])
        for side in ([0, -0.5, 0], [0, 0, 0.5]):
            query = (x[:, None] * [1.0, 0, 0] + side) @ axes.T
            projection = project_to_fans(query, proxy, at(proxy, [0] * 30))
            assert np.allclose(distances(query, proxy, projection), 0.5, rtol=0, atol=1e-14)


def test_equally_near_triangles_are_told_apart_without_their_numbers(bound):
    mesh, result, proxy, projection = bound
    order = np.random.default_rng(3).permutation(proxy.m)
    rolled = np.array([np.roll(f, i % 3) for i, f in enumerate(proxy.F[order])])
    again = project_to_fans(mesh.V, Mesh(proxy.V, rolled), result)
    assert np.array_equal(order[again.face], projection.face)
    apart = distances(mesh.V, Mesh(proxy.V, rolled), again) - distances(mesh.V, proxy, projection)
    assert np.abs(apart).max() <= 1e-14 * mesh.diagonal

"""Cutting meshes into oriented manifolds."""

import numpy as np
import pytest

from sshade import InputError, Mesh
from sshade.mesh import cutting as module
from sshade.mesh.cutting import cut_to_manifold
from tests.shapes import beside, block, bumpy, quads, strip, subdivided, tube, unjoined

BODY = bumpy(2)


def cut(mesh: Mesh):
    """Cut a mesh, and check the properties of every cut."""
    found = cut_to_manifold(mesh)
    assert found.mesh.is_manifold and found.mesh.is_oriented
    assert np.array_equal(found.origin[: mesh.n], np.arange(mesh.n))  # the original vertices come first
    assert np.array_equal(found.mesh.V, mesh.V[found.origin])
    F = found.origin[found.mesh.F]
    same, back = ((own[: mesh.m] == mesh.F).all(axis=1) for own in (F, F[:, ::-1]))
    assert (same | back).all() and int((~same).sum()) == found.turned
    assert np.array_equal(F[mesh.m :, ::-1], mesh.F[found.one_sided])
    return found


def t_fin(height: int = 3) -> Mesh:
    """Return a strip with a second strip that stands on the middle line of the first strip."""
    base = strip(10, 4)
    return with_fin(base, 5 * np.arange(11) + 2, np.outer(np.arange(height) + 1, [0, 0, 1]))


def with_fin(base: Mesh, row: np.ndarray, shifts: np.ndarray) -> Mesh:
    """Return a mesh with a strip that stands on a row of vertices; shifted copies are the strip's rows."""
    rows = np.concatenate([row[None], base.n + np.arange(len(shifts) * len(row)).reshape(-1, len(row))])
    F = rows.ravel()[quads(len(rows), len(row))][:, ::-1]
    V = (base.V[row] + shifts[:, None]).reshape(-1, 3)
    return Mesh(np.concatenate([base.V, V]), np.concatenate([base.F, F]))


def moebius(around: int = 24, *, half_turns: int = 1) -> Mesh:
    """Return a closed band, three vertices wide; an odd number of half turns makes it one-sided."""
    a, x = np.repeat(2 * np.pi * np.arange(around) / around, 3), np.tile([-0.3, 0, 0.3], around)
    ring, tilt = 1 + x * np.cos(half_turns * a / 2), half_turns * a / 2
    V = np.stack([ring * np.cos(a), ring * np.sin(a), x * np.sin(tilt)], axis=1)
    F = quads(around + 1, 3)
    last, across = 3 * around <= F, F - 3 * around
    return Mesh(V, np.where(last, 2 - across if half_turns % 2 else across, F))


def klein_bottle(around: int = 40, across: int = 20) -> Mesh:
    """Return a closed one-sided surface that crosses itself: a figure eight makes half a turn."""
    size = (around, across)
    u, v = (2 * np.pi * p.ravel() / n for p, n in zip(np.indices(size), size, strict=True))
    out = np.cos(u / 2) * np.sin(v) - np.sin(u / 2) * np.sin(2 * v)
    up = np.sin(u / 2) * np.sin(v) + np.cos(u / 2) * np.sin(2 * v)
    i, j = np.divmod(quads(around + 1, across, wrap_v=True), across)
    F = np.where(i == around, -j % across, i * across + j)
    return Mesh(np.stack([(2.5 + out) * np.cos(u), (2.5 + out) * np.sin(u), up], axis=1), F)


def projective_plane(level: int = 2) -> Mesh:
    """Return the triangulation with six vertices, and divide every triangle into 4^level triangles."""
    F = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5], [0, 5, 1], [1, 2, 4], [2, 3, 5], [3, 4, 1], [4, 5, 2]]
    mesh = Mesh(np.random.default_rng(0).normal(size=(6, 3)), np.array([*F, [5, 1, 3]]))
    for _ in range(level):
        mesh = subdivided(mesh)
    return mesh


@pytest.mark.parametrize("mesh", [BODY, tube(), unjoined(BODY)])
def test_an_oriented_manifold_is_returned_itself(mesh):
    assert cut(mesh).mesh is mesh


@pytest.mark.parametrize("turned", [[11], range(0, 320, 7), range(300)])
def test_the_fewer_faces_are_reversed(turned):
    F = BODY.F.copy()
    F[list(turned)] = F[list(turned)][:, ::-1]
    found = cut(Mesh(BODY.V, F))
    assert found.mesh.n == BODY.n and found.turned == min(len(turned), BODY.m - len(turned))
    assert np.array_equal(found.mesh.F, BODY.F if len(turned) < 160 else BODY.F[:, ::-1])


def test_a_fin_comes_off_and_what_it_stands_on_stays_whole():
    mesh = t_fin()
    found = cut(mesh)
    assert len(found.origin) == mesh.n + 11 and found.turned == 0
    assert found.mesh.topology == (2, 2, 2)  # two discs
    assert set(found.origin[mesh.n :]) == set(5 * np.arange(11) + 2)
    # The base strip stays whole, because a cut prefers straight continuations to corners.
    assert np.array_equal(found.mesh.F[: strip(10, 4).m], strip(10, 4).F)


def test_solids_that_touch_along_an_edge_or_at_a_corner_come_apart():
    edge, corner = np.zeros((2, 2, 1)), np.zeros((2, 2, 2))
    edge[0, 0] = edge[1, 1] = 1
    corner[0, 0, 0] = corner[1, 1, 1] = 1
    for solid, copies in ((edge, 4), (corner, 1)):
        mesh = block(solid, cells=3)
        found = cut(mesh)
        assert len(found.origin) == mesh.n + copies and found.turned == 0
        assert found.mesh.topology == (4, 2, 0)  # two closed surfaces
        assert found.mesh.volume == pytest.approx(2.0)  # -2 if both solids were inside out, 0 if one


@pytest.mark.parametrize(
    ("mesh", "cover"),
    [
        (moebius(), (0, 1, 2)),  # an annulus
        (klein_bottle(), (0, 1, 0)),  # a torus
        (projective_plane(0), (2, 1, 0)),  # a sphere
        (projective_plane(), (2, 1, 0)),
    ],
)
def test_a_one_sided_surface_is_covered_twice_and_stays_whole(mesh, cover):
    assert mesh.is_manifold and not mesh.is_oriented
    found = cut(mesh)
    assert found.mesh.topology == cover and found.one_sided.all() and found.turned == 0
    assert (np.bincount(found.origin) == 2).all()


def test_a_fin_on_a_one_sided_band_comes_off_and_two_sided_components_stay_single():
    band = moebius()
    mesh = with_fin(band, 3 * np.arange(9) + 1, np.array([[0, 0, 0.3]]))
    found = cut(beside(mesh, BODY))
    assert found.mesh.topology == (0 + 1 + 2, 3, 2 + 1)  # an annulus, a disc and a sphere
    assert np.array_equal(found.one_sided, np.arange(band.m + 16 + BODY.m) < band.m)
    assert found.mesh.n == 2 * band.n + 18 + BODY.n


def test_many_random_triangles_become_a_manifold():
    rng = np.random.default_rng(0)
    for _ in range(20):
        n = int(rng.integers(5, 12))
        F = np.array([rng.permutation(n)[:3] for _ in range(3 * n)])
        V = rng.normal(size=(n, 3))
        used = np.unique(F)
        cut(Mesh(V[used], np.searchsorted(used, F)))


def test_what_no_cut_helps_is_refused(monkeypatch):
    monkeypatch.setattr(module, "_fans", lambda mesh, edges, pairs: (mesh.F, np.arange(mesh.n)))
    with pytest.raises(InputError, match="cutting it there does not make it so"):
        cut_to_manifold(t_fin())

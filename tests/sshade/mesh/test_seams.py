"""Seams: vertices that are merged, and what touches at rest touches after a deformation, in all formats."""

import gc
import weakref
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sshade import DeformationTask, Handles, Mesh, deform
from sshade.files.meshes import read_file
from sshade.files.open_shape import open_shape
from sshade.mesh import places
from sshade.mesh.places import same_places
from sshade.mesh.surface import single_steps, surface
from tests.shapes import beside, icosphere, jittered, quads, shifted, strip, unjoined
from tests.sshade.mesh.test_cutting import moebius
from tests.write import mesh_ply, obj

SPHERE = icosphere(2)


def split(mesh: Mesh, first: np.ndarray) -> Mesh:
    """Return the mesh cut along the border of the faces `first` (m,) bool, with separate vertices."""
    F = np.where(first[:, None], mesh.F, mesh.F + mesh.n)
    used, F = np.unique(F, return_inverse=True)
    return Mesh(np.concatenate([mesh.V, mesh.V])[used], F.reshape(-1, 3))


HALF = SPHERE.V[SPHERE.F].mean(axis=1)[:, 0] > 0


@pytest.mark.parametrize(
    "parts",
    [unjoined(SPHERE), split(SPHERE, HALF), split(SPHERE, np.random.default_rng(1).random(SPHERE.m) < 0.3)],
)
def test_a_surface_cut_anywhere_becomes_whole_again(parts):
    joined, vertex, facts = surface(parts.V, parts.F)
    assert parts.n > SPHERE.n == joined.n and joined.m == SPHERE.m
    assert facts.near == 0
    assert np.array_equal(joined.V[vertex], parts.V) and np.array_equal(joined.F, vertex[parts.F])
    assert joined.topology == SPHERE.topology


def test_without_a_seam_arrays_are_not_even_copied():
    square = strip(2, 2)
    point = beside(square, Mesh(-square.V, square.F))  # two parts that touch in a point
    twice = beside(SPHERE, SPHERE)
    parallel = beside(square, square)  # the same orientation twice
    for mesh in (SPHERE, point, twice, parallel):
        joined, vertex, _ = surface(mesh.V, mesh.F)
        assert joined.V is mesh.V and joined.F is mesh.F and np.array_equal(vertex, np.arange(mesh.n))


def test_a_pole_of_many_vertices_with_faces_without_area_closes():
    """Exporters make a globe of rows of squares; each pole is a row of many vertices at one place."""
    k = 8
    angle = 2 * np.pi * (np.arange(k + 1) % k) / k
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(k + 1)])
    V = np.concatenate([ring, np.tile([0.0, 0, 1], (k + 1, 1)), ring, np.tile([0.0, 0, -1], (k + 1, 1))])
    up = quads(2, k + 1)
    F = np.concatenate([up, up[:, ::-1] + 2 * (k + 1)])
    joined, vertex, _ = surface(V, F)
    assert joined.n == k + 2 and joined.is_closed and joined.topology.euler == 2
    assert np.array_equal(joined.V[vertex], V)


def test_near_places_are_one_but_neither_chains_nor_crowds():
    tolerance = np.full(3, 0.1)
    assert same_places(np.array([[0.0, 0, 0], [0.05, 0, 0], [1, 0, 0]]), tolerance).tolist() == [0, 0, 2]
    chain, crowd = np.outer(np.arange(100), [0.15, 0, 0]), np.random.default_rng(0).random((3000, 3)) / 20
    for points in (chain, crowd):
        assert len(np.unique(same_places(points, tolerance))) == len(points)


@pytest.mark.parametrize("mesh", [SPHERE, moebius(20), strip(9, 7)])
def test_parts_whose_triangles_disagree_about_their_direction_become_whole(mesh):
    turned = np.random.default_rng(0).random(mesh.m) < 0.3
    for parts in (unjoined(mesh), split(mesh, turned)):
        joined, vertex, _ = surface(parts.V, np.where(turned[:, None], parts.F[:, ::-1], parts.F))
        assert joined.n == mesh.n and joined.topology == mesh.topology
        assert np.array_equal(joined.V[vertex], parts.V)


def test_sheets_upon_each_other_stay_two_unless_repaired():
    sheet = jittered(strip(9, 7), 0.2)
    other = Mesh(sheet.V, sheet.F[:, [1, 2, 0]])
    for noise in (0.0, 1e-10, 1e-6):
        two = beside(sheet, shifted(other, noise * sheet.diagonal))
        assert surface(two.V, two.F).mesh.n == two.n
        assert (surface(two.V, two.F, repair=True).mesh.n == sheet.n) == (noise < 1e-9)


def test_a_rim_that_is_finer_than_the_tolerance_is_no_seam():
    """The mesh is far from the origin: neighbours are only three steps of single precision apart."""
    land = strip(30, 20)
    V = (0.1 * land.V + [5e5, 4e5, 0]).astype(np.float32)
    assert surface(V, land.F).mesh.n == land.n


def test_merging_takes_no_vertex_its_last_face():
    """A face has two corners at one place. If they were merged, its third corner would have no face."""
    V = np.array([[0.0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 2, 0], [1, 2, 0]])
    joined, vertex, _ = surface(V, np.array([[0, 1, 2], [3, 4, 5]]))
    assert joined.n == 6 and (vertex >= 0).all()


def test_the_tolerance_decides_which_gaps_close():
    parts = split(SPHERE, HALF)
    V = np.array(parts.V)
    V[parts.n // 2 :] += 1e-7
    assert not surface(V, parts.F).mesh.is_closed
    whole = surface(V, parts.F, weld=1e-6)
    assert whole.mesh.topology == SPHERE.topology and whole.facts.near > 0
    assert not surface(parts.V + np.where(parts.V == V, 0, 1e-14), parts.F, weld=0).mesh.is_closed


SLIVERS = strip(30, 1)


def test_slivers_are_a_surface():
    assert surface(SLIVERS.V * [1, 1e-9, 1], SLIVERS.F, repair=True).mesh.n == SLIVERS.n


#: Cells of a sheet along x and y. A slit begins in its middle and goes to its right end.
CELLS = 8
#: Formats and types of arrays, and whether they hold single precision.
KINDS = {"ply": True, "obj": False, "float32": True, "float64": False}


def slit_sheet(gap: float, rng=None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a sheet with edges of length 1: vertices, faces, and (2, k) vertices below and above its slit.

    A seam without a gap goes on from the slit to the left end: its pairs come first.
    """
    n = CELLS + 1
    x, y = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    V = np.column_stack([x.ravel(), y.ravel(), np.zeros(n * n)]).astype(np.float64)
    if rng is not None:
        V += rng.uniform(-0.2, 0.2, V.shape)
    F = quads(n, n)
    below = np.flatnonzero(y.ravel() == CELLS // 2)
    above = y.ravel()[F].mean(axis=1) > CELLS // 2
    copy = np.arange(n * n)
    copy[below] = n * n + np.arange(n)
    F = np.where(above[:, None], copy[F], F)
    V = np.concatenate([V, V[below]])
    V[n * n + CELLS // 2 + 1 :, 1] += gap
    return V, F, np.stack([below, n * n + np.arange(n)])


def stored(kind: str, V: np.ndarray, F: np.ndarray, folder: Path):
    """Store a mesh; return an open shape and its vertices."""
    if kind in ("float32", "float64"):
        W = V.astype(kind)
        return open_shape(W, F), W.astype(np.float64)
    path = folder / f"mesh.{kind}"
    path.write_bytes(obj(V, F) if kind == "obj" else mesh_ply(V, F, "<", "float"))
    file = read_file(path)
    return open_shape(file), file.V


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("copies")


@given(
    kind=st.sampled_from(list(KINDS)),
    gap=st.floats(-6, -1),
    origin=st.one_of(st.just(0.0), st.floats(0, 8).map(lambda power: 10.0**power)),
    edge=st.floats(-2, 2),
    seed=st.integers(0, 10**6),
)
def test_what_touches_stays_together_and_what_does_not_may_open(folder, kind, gap, origin, edge, seed):
    rng, single = np.random.default_rng(seed), KINDS[kind]
    V, F, (below, above) = slit_sheet(10**gap, rng)
    step = float(np.spacing(np.array(origin, np.float32 if single else np.float64)))
    size = max(10**edge, 64 * step)  # a sheet of rounding errors is no surface
    V = size * V + origin * rng.uniform(-1, 1, 3)
    opened, rest = stored(kind, V, F, folder)
    vertex = opened.surface.vertex
    apart = np.abs(rest[above] - rest[below]).max(axis=1)
    touching = apart == 0
    # Also two numbers that rounding made different count as copies.
    rounded = apart <= (4 * single_steps(rest).max() if single else 0)
    assert touching[: CELLS // 2].all()
    assert (vertex[below] == vertex[above])[touching].all()
    assert (vertex[below] != vertex[above])[~rounded].all()
    assert opened.mesh.m == len(F)
    held = vertex[np.flatnonzero(np.arange(len(V)) < 2 * (CELLS + 1))]  # the left end
    ends = np.array([vertex[CELLS * (CELLS + 1)], vertex[(CELLS + 1) ** 2 - 1]])  # of the right end
    up = size * np.array([[0, 0, 1.0], [0, 0, -1.0]])
    index = np.concatenate([np.unique(held), ends])
    target = opened.mesh.V[index]
    target[-2:] += up
    task = DeformationTask("m", opened.mesh, Handles(index, target))
    result = deform(task, volume=0, area=0)
    posed = opened.placed(result.vertices)
    opening = np.linalg.norm(posed[above] - posed[below], axis=1)
    assert (opening[touching] == 0).all()
    assert rounded[-1] or opening[-1] > 0.2 * size
    reported = result.facts.opening * opened.mesh.diagonal
    assert reported == pytest.approx(opening.max()) or (reported == 0 and apart.max() > 1e-7 * size)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_whole_metres_at_map_coordinates_keep_their_slit(dtype):
    """The type of arrays tells whether they are rounded, their values do not. A step is half a metre here."""
    V, F, (below, above) = slit_sheet(0.0)
    V = V * 64 + [432128, 4649024, 0]
    V[above[5:], 1] += 1
    vertex = surface(V.astype(dtype), F).vertex
    assert ((vertex[below] == vertex[above]) == (np.arange(9) < 5)).all()


def test_a_weld_that_is_given_is_obeyed():
    V, F, (below, above) = slit_sheet(0.0)
    V = (V + [1e4, 0, 0]).astype(np.float32)
    V[above, 0] = np.nextafter(V[above, 0], np.float32(0))  # a millimetre, of edges of a metre
    widths = {None: True, 1e-3: True, 1e-9: False, 0: False}
    for weld, joined in widths.items():
        vertex = surface(V, F, weld=weld).vertex
        assert (vertex[below] == vertex[above]).all() == joined == (vertex[below] == vertex[above]).any()


def test_touching_vertices_are_looked_for_once_and_forgotten_with_the_mesh(monkeypatch):
    looked, mesh, touching = [], icosphere(1), places.touching
    monkeypatch.setattr(places, "touching", lambda *given: looked.append(1) or touching(*given))
    for _ in range(3):
        assert places.opening_within(mesh, mesh.V) == 0
    gone = weakref.ref(mesh)
    del mesh
    gc.collect()
    assert len(looked) == 1 and gone() is None


def hourglass() -> tuple[np.ndarray, np.ndarray]:
    """Return two cones that meet at their tips."""
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.ones(12)])
    V = np.concatenate([[[0, 0, 0]], ring / 2, ring, ring * [0.5, 0.5, -0.5], ring * [1, 1, -1]])
    i, j = np.arange(12), (np.arange(12) + 1) % 12
    fan = np.column_stack([0 * i, 1 + i, 1 + j])
    sides = [np.column_stack([1 + i, 13 + i, 13 + j]), np.column_stack([1 + i, 13 + j, 1 + j])]
    F = np.concatenate([fan, *sides])
    return V, np.concatenate([F, np.where(F > 0, F + 24, 0)[:, ::-1]])


def in_soup(F: np.ndarray) -> np.ndarray:
    return np.arange(F.size).reshape(-1, 3)


def with_split_vertices(F: np.ndarray) -> np.ndarray:
    """Give each pair of faces vertices of its own, as exporters do for flat shading."""
    copies = F + len(F) * 3 * (np.arange(len(F)) // 2)[:, None]
    return np.unique(copies, return_inverse=True)[1].reshape(-1, 3)


@pytest.mark.parametrize("split", [in_soup, with_split_vertices])
def test_a_pinched_vertex_is_one_in_every_file(split):
    V, F = hourglass()
    whole, G = surface(V, F).mesh, split(F)
    W = np.empty((G.max() + 1, 3))
    W[G] = V[F]
    found = surface(W, G)
    assert not whole.is_manifold and whole.topology.components == 1
    assert found.mesh.n == whole.n
    order = np.lexsort(whole.V.T), np.lexsort(found.mesh.V.T)
    assert np.array_equal(whole.V[order[0]], found.mesh.V[order[1]])
    # Both are the same mesh with other numbers, so that they deform alike.
    to = np.empty(whole.n, dtype=np.int64)
    to[order[1]] = order[0]
    one, other = ({tuple(sorted(f)) for f in faces.tolist()} for faces in (to[found.mesh.F], whole.F))
    assert one == other


def test_a_closed_surface_with_two_vertices_at_its_pinch_is_joined_there():
    """Programs that make meshes manifold give each fan a vertex of its own."""
    ball = icosphere(2)
    V = ball.V.copy()
    far = int(np.argmin(V @ V[0]))
    V[far] = V[0]
    assert surface(V, ball.F).mesh.n == ball.n - 1
    near, beyond = (ball.F[(vertex == ball.F).any(axis=1)][0] for vertex in (0, far))
    V[beyond[beyond != far][0]] = V[near[near != 0][0]]  # it touches itself along an edge, as closed lips do
    assert surface(V, ball.F).mesh.n == ball.n

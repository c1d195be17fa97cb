"""What touches at rest touches after a deformation, and what does not may open: in all formats and arrays."""

import gc
import weakref
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sshade import DeformationTask, Handles, deform
from sshade.files.meshes import read_file
from sshade.files.open_shape import open_shape
from sshade.mesh import places
from sshade.mesh.surface import single_steps, surface
from tests.shapes import icosphere, quads
from tests.write import mesh_ply, obj

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

"""A mesh bound to a proxy: frames of its triangles and vertices, invariances, and binding files."""

import igl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.ablations.affine_frames import StretchingFrames
from baselines.ablations.named_frames import named_frames
from sshade import InputError, Mesh, bind, load_binding, save_binding
from sshade.proxy.binding import FrameKind
from sshade.proxy.blended import BlendedFrames, nearest_rotations
from sshade.proxy.projection import Projection
from sshade.proxy.triangle import TriangleFrames, frame_values
from sshade.proxy.vertex_maps import VertexMaps, fill_from_neighbours
from tests.shapes import bent, block, bumpy, family, jittered, rotation, strip

#: Largest difference of positions due to rounding, as a fraction of the bounding-box diagonal.
ROUNDING = 1e-12

MESHES = family()
BUMPY = MESHES["bumpy"]
KINDS: list[FrameKind] = ["triangle", "blended"]
#: These and the frames of the ablations.
EVERY = {kind: kind for kind in KINDS} | {kind: named_frames(kind) for kind in ("affine", "blended_affine")}


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("kind", EVERY)
def test_an_undeformed_and_a_rigidly_moved_proxy_carry_the_mesh_exactly(name, kind):
    mesh, turn, shift = MESHES[name], rotation(1), np.array([3.0, -1, 2])
    binding = bind(mesh, mesh.n // 6, frames=EVERY[kind])
    for R, t in ((np.eye(3), np.zeros(3)), (turn, shift)):
        given = np.broadcast_to(R, (binding.proxy.n, 3, 3))
        for rotations in (None, given):
            V, degenerate = binding.carry(binding.proxy.V @ R.T + t, rotations=rotations)
            assert degenerate == 0
            assert np.abs(V - (mesh.V @ R.T + t)).max() <= ROUNDING * mesh.diagonal


def test_a_mesh_far_from_the_origin_is_bound_as_near_it():
    mesh = Mesh(np.round(BUMPY.V * 2**20) / 2**20, BUMPY.F)
    near, far = bind(mesh, 80), bind(Mesh(mesh.V + 2.0**30, mesh.F), 80)
    assert np.array_equal(near.projection.face, far.projection.face)
    np.testing.assert_allclose(near.projection.barycentric, far.projection.barycentric, atol=1e-12)


def test_a_linear_function_on_the_proxy_has_its_values_at_the_projections():
    binding = bind(BUMPY, 80)
    linear = binding.proxy.V @ np.arange(6.0).reshape(3, 2) + [1, -2]
    found = binding.prolong(linear)
    corners = binding.proxy.V[binding.proxy.F[binding.projection.face]]
    points = sum(binding.projection.barycentric[:, [c]] * corners[:, c] for c in range(3))
    np.testing.assert_allclose(found, points @ np.arange(6.0).reshape(3, 2) + [1, -2], atol=1e-12)
    np.testing.assert_allclose(found[binding.sampling.samples], linear, atol=1e-12)  # samples keep theirs
    np.testing.assert_allclose(binding.prolong(linear[:, 0]), found[:, 0], atol=1e-12)
    for wrong in (linear[:-1], linear[0, 0], linear[:, :, None]):
        with pytest.raises(InputError, match="the proxy has 80 vertices"):
            binding.prolong(wrong)


def along_x(proxy: Mesh, samples: np.ndarray) -> TriangleFrames:
    """Frames of the user: triangle frames with another function."""
    return TriangleFrames.of_values(proxy, frame_values(proxy, 0))


@pytest.mark.parametrize("frames", [*KINDS, along_x])
def test_a_binding_read_back_has_its_frames_or_those_that_are_asked_for(tmp_path, frames):
    binding = bind(BUMPY, 80, frames=frames)
    save_binding(tmp_path / "map.npz", binding)
    assert [p.name for p in tmp_path.iterdir()] == ["map.npz"]
    NV = bent(binding.proxy.V)
    again = load_binding(tmp_path / "map.npz", BUMPY)
    assert again.frames.name == binding.frames.name
    assert np.array_equal(binding.carry(NV)[0], again.carry(NV)[0])
    assert np.array_equal(binding.projection.barycentric, again.projection.barycentric)
    for other in (*KINDS, along_x):
        asked = load_binding(tmp_path / "map.npz", BUMPY, frames=other)
        saved = frames if other == "triangle" == binding.frames.name else other  # with its function
        direct = bind(BUMPY, 80, frames=saved)
        assert asked.frames.name == direct.frames.name
        assert np.array_equal(asked.carry(NV)[0], direct.carry(NV)[0])


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("region", lambda cell: np.where(cell == 39, 40, cell)),
        ("region", lambda _: None),
        ("samples", lambda samples: samples.astype(float)),
        ("distance", lambda distance: distance[1:]),
        ("frames", lambda _: np.array("quaternion")),
    ],
)
def test_a_map_whose_arrays_do_not_fit_together_is_refused(tmp_path, name, change):
    save_binding(tmp_path / "map.npz", bind(BUMPY, 40))
    with np.load(tmp_path / "map.npz") as stored:
        arrays = dict(stored)
    arrays[name] = change(arrays[name])
    np.savez(tmp_path / "map.npz", **{key: array for key, array in arrays.items() if array is not None})
    with pytest.raises(InputError, match=r"map\.npz: "):
        load_binding(tmp_path / "map.npz", BUMPY)


def points_on(mesh: Mesh, count: int) -> Projection:
    """Random points in random triangles."""
    rng = np.random.default_rng(0)
    return Projection(rng.integers(0, mesh.m, count), rng.dirichlet([1, 1, 1], count))


def turns(count: int, *, most: float, seed: int = 0) -> np.ndarray:
    """(count, 3, 3) rotations about random axes by up to `most` radians."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return Rotation.from_rotvec(axes * rng.uniform(0, most, (count, 1))).as_matrix()


def half_way(R: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the pose in the middle of the screw motion from one pose to another.

    The whole motion is x -> turn x + shift. The half motion, applied twice, gives the whole motion.
    """
    turn = R[1] @ R[0].T
    shift = v[1] - turn @ v[0]
    half = Rotation.from_rotvec(0.5 * Rotation.from_matrix(turn).as_rotvec()).as_matrix()
    return half @ R[0], half @ v[0] + np.linalg.solve(half + np.eye(3), shift)


def one_by_one(proxy: Mesh, V: np.ndarray, *, on: Projection, NV, R, S: np.ndarray) -> np.ndarray:
    """Evaluate blended frames point by point from the definition; S stretches frames at vertices."""
    moved = np.empty_like(V)
    for i, (t, w) in enumerate(zip(on.face, on.barycentric, strict=True)):
        corners = proxy.F[t]
        o = w @ NV[corners]
        for a, b in ((0, 1), (1, 2), (2, 0)):
            ends = corners[[a, b]]
            turn, middle = half_way(R[ends], NV[ends])
            e = proxy.V[ends[1]] - proxy.V[ends[0]]
            bulge = 4 * (middle - NV[ends].mean(axis=0))
            o += w[a] * w[b] * (bulge + 0.5 * turn @ (S[ends[0]] - S[ends[1]]) @ e)
        q = Rotation.from_matrix(R[corners]).as_quat()
        turn = Rotation.from_quat(w @ (q * np.where(q @ q[0] < 0, -1.0, 1.0)[:, None])).as_matrix()
        moved[i] = o + turn @ np.einsum("c,cxy->xy", w, S[corners]) @ (V[i] - w @ proxy.V[corners])
    return moved


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("kind", ["blended", "blended_affine"])
def test_samples_go_where_their_proxy_vertices_go_to_the_last_bit(name, kind):
    mesh = MESHES[name]
    binding = bind(mesh, mesh.n // 6, frames=EVERY[kind])
    NV = bent(binding.proxy.V, 0.5) @ rotation(2).T
    assert np.array_equal(binding.carry(NV)[0][binding.sampling.samples], NV)


def test_decoding_follows_the_definition():
    proxy = bumpy(1)
    on, rng = points_on(proxy, 60), np.random.default_rng(1)
    V = np.einsum("nc,ncx->nx", on.barycentric, proxy.V[proxy.F[on.face]]) + 0.1 * rng.normal(size=(60, 3))
    NV = bent(proxy.V, 0.5) @ rotation(3).T
    R, unit = turns(proxy.n, most=0.9), np.broadcast_to(np.eye(3), (proxy.n, 3, 3))
    A = VertexMaps.at_rest(proxy)(NV)[0]
    fitted = nearest_rotations(A)
    stretches = fitted.transpose(0, 2, 1) @ A
    blended, stretching = BlendedFrames(proxy), StretchingFrames(proxy)  # these use no given rotations
    for frames, given, used, S in (
        (blended, R, R, unit),
        (blended, None, fitted, unit),
        (stretching, None, fitted, stretches),
        (stretching, unit, fitted, stretches),
    ):
        moved, missing = frames.decode(frames.encode(V, on), NV, on=on, rotations=given)
        assert missing == 0
        expected = one_by_one(proxy, V, on=on, NV=NV, R=used, S=S)
        np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-12)


def test_opposite_quaternions_of_nearly_equal_rotations_do_not_cancel():
    """Two corners have half turns about nearly the same axis.

    Both half turns are equally far from the rotation of the third corner.
    """
    triangle = Mesh([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    half = Rotation.from_rotvec(np.pi * np.array([[1, -0.999, 0], [1, -1.001, 0]]) / np.sqrt(2)).as_matrix()
    half = 2 * np.round((half + np.eye(3)) / 2, 12) - np.eye(3)
    R = np.concatenate([np.eye(3)[None], half])
    on = Projection(np.zeros(1, dtype=np.int64), np.array([[0.0, 0.5, 0.5]]))
    frames = BlendedFrames(triangle)
    offset = np.array([[0.3, -0.4, 0.5]])
    moved, _ = frames.decode(offset, triangle.V, on=on, rotations=R)
    expected = [0.5, 0.5, 0] + half.mean(axis=0) @ offset[0]
    np.testing.assert_allclose(moved[0], expected, rtol=0, atol=2e-3)


@pytest.mark.parametrize(("kind", "most"), [("blended", 20), ("blended_affine", 20), ("affine", 40)])
def test_collapsed_parts_of_the_proxy_are_counted(kind, most):
    """20 neighbouring vertices are at one place, after a turn."""
    binding, turn = bind(bumpy(3), 100, frames=EVERY[kind]), rotation(5)
    V, NV = binding.proxy.V, binding.proxy.V @ turn.T
    NV[np.argsort(np.linalg.norm(V - V[20], axis=1))[:20]] = NV[20]
    V, missing = binding.carry(NV)
    assert 0 < missing < most and np.isfinite(V).all()
    given = np.broadcast_to(turn, (binding.proxy.n, 3, 3))
    assert (binding.carry(NV, rotations=given)[1] == 0) == (kind == "blended")


BODY = bumpy(2)
#: Length of the gradient of f below which f_2 replaces f.
FLAT = 0.1


def igl_gradients(mesh: Mesh, values: np.ndarray) -> np.ndarray:
    """(m, 3) tangential gradient of one value a vertex on each triangle."""
    G = igl.grad(np.array(mesh.V), np.array(mesh.F))
    return np.asarray((G @ values).reshape(3, mesh.m).T)


def at(face) -> Projection:
    """Points at the barycentres of triangles."""
    face = np.asarray(face)
    return Projection(face, np.full((len(face), 3), 1 / 3))


def test_g_is_the_normalised_gradient_n_the_normal_and_w_their_product():
    axis = np.argmin(np.abs(BODY.face_normals), axis=1)
    frames = TriangleFrames.of_values(BODY, BODY.V[BODY.F, axis[:, None]])
    every = np.stack([igl_gradients(BODY, x) for x in BODY.V.T], axis=1)
    gradients = every[np.arange(BODY.m), axis]
    g, w, n = frames.L.transpose(2, 0, 1)
    assert np.allclose(g, gradients / np.linalg.norm(gradients, axis=1, keepdims=True), rtol=0, atol=1e-12)
    assert np.allclose(n, BODY.face_normals, rtol=0, atol=1e-13)
    assert np.allclose(w, np.cross(g, n), rtol=0, atol=1e-14)
    assert np.allclose(frames.origin, BODY.V[BODY.F].mean(axis=1), rtol=0, atol=1e-15)
    assert not frames.degenerate.any()
    assert not TriangleFrames.at_rest(Mesh(BODY.V * 1e-30, BODY.F)).degenerate.any()
    for height, degenerate in ((1e-13, True), (1e-10, False)):
        needle = Mesh([[0.0, 0, 0], [1, 0, 0], [0.5, height, 0]], [[0, 1, 2]])
        assert TriangleFrames.of_values(needle, np.array([[0.0, 1, 0.5]])).degenerate.all() == degenerate


@pytest.mark.parametrize(("given", "axis", "second"), [(None, 2, 1), (2, 2, 1), (0, 0, 2), (1, 1, 2)])
def test_a_coordinate_gives_way_exactly_where_its_gradient_is_under_the_threshold(given, axis, second):
    # The block is longest along z and shortest along x. The jitter tilts some normals of the sides by more
    # than the threshold, others by less.
    mesh = jittered(block(np.ones((2, 3, 5)), cells=2), 0.03)
    order = np.argsort(-np.ptp(mesh.V, axis=0))
    assert order.tolist() == [2, 1, 0]
    length = np.linalg.norm(igl_gradients(mesh, mesh.V[:, axis]), axis=1)
    flat = length < FLAT
    assert flat.any() and not flat.all() and np.abs(length - FLAT).min() > 1e-9
    expected = np.where(flat[:, None], mesh.V[mesh.F, second], mesh.V[mesh.F, axis])
    assert np.array_equal(frame_values(mesh, given), expected)
    replaced = TriangleFrames.of_values(mesh, expected)
    if given is None:
        assert np.array_equal(TriangleFrames.at_rest(mesh).L, replaced.L)
    gradient = igl_gradients(mesh, mesh.V[:, second])[flat]
    g = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
    assert np.allclose(replaced.L[flat, :, 0], g, rtol=0, atol=1e-10)


def collapsed(mesh: Mesh, face: int, NV: np.ndarray) -> np.ndarray:
    """Return NV with the third corner of a face moved to the middle of the other two corners."""
    NV = NV.copy()
    a, b, c = mesh.F[face]
    NV[c] = 0.5 * (NV[a] + NV[b])
    return NV


def assert_mean_turn(frames: TriangleFrames, face: int, NV: np.ndarray) -> None:
    """Assert that a triangle turns by the rotation nearest to the sum of its edge neighbours' rotations."""
    deformed = TriangleFrames.of_values(Mesh(NV, frames.F), frames.values)
    missing = frames.degenerate | deformed.degenerate
    on = at(np.full(4, face))
    points = frames.origin[face] + np.concatenate([np.zeros((1, 3)), np.eye(3)])
    moved, count = frames.decode(frames.encode(points, on), NV, on=on)
    assert missing[face] and count == missing.sum()
    beside = np.flatnonzero((np.isin(frames.F, frames.F[face]).sum(axis=1) == 2) & ~missing)
    U, _, Vt = np.linalg.svd(sum(deformed.L[t] @ frames.L[t].T for t in beside))
    turn = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    assert np.allclose((moved[1:] - moved[0]).T, turn, rtol=0, atol=1e-9)
    assert np.allclose(moved[0], NV[frames.F[face]].mean(axis=0), rtol=0, atol=1e-12)


def test_zero_area_triangles_turn_like_the_mean_of_their_neighbours():
    frames = TriangleFrames.at_rest(BODY)
    assert_mean_turn(frames, 30, collapsed(BODY, 30, bent(BODY.V) @ rotation(4).T))
    sheet = strip(4, 3)
    for face in (8, 9):  # onto an edge along x, where f stays constant, and onto a diagonal
        at_rest = TriangleFrames.at_rest(Mesh(collapsed(sheet, face, sheet.V), sheet.F))
        assert_mean_turn(at_rest, face, bent(sheet.V) @ rotation(5).T)


def ring_of(mesh: Mesh, i: int) -> np.ndarray:
    """Neighbours of a vertex, ascending."""
    faces = mesh.F[np.isin(mesh.F, i).any(axis=1)]
    return np.setdiff1d(faces, [i])


def unit_normals(mesh: Mesh) -> np.ndarray:
    """(n, 3) sums of the area-weighted normals of the faces at each vertex, normalised."""
    a, b, c = (mesh.V[mesh.F[:, i]] for i in range(3))
    total = np.zeros_like(mesh.V)
    for corner in range(3):
        np.add.at(total, mesh.F[:, corner], np.cross(b - a, c - a))
    return total / np.linalg.norm(total, axis=1, keepdims=True)


def by_lstsq(rest: Mesh, V: np.ndarray, i: int) -> np.ndarray:
    """The definition, solved as weighted linear equations for one vertex."""
    ring = ring_of(rest, i)
    e, deformed = rest.V[ring] - rest.V[i], V[ring] - V[i]
    length = np.linalg.norm(e, axis=1)
    weight = length**-1.5
    normal = np.sqrt(0.5 * (weight**2 * length**2).sum())
    rows = np.concatenate([weight[:, None] * e, normal * unit_normals(rest)[i : i + 1]])
    sides = np.concatenate([weight[:, None] * deformed, normal * unit_normals(Mesh(V, rest.F))[i : i + 1]])
    return np.linalg.lstsq(rows, sides, rcond=None)[0].T


def test_the_maps_are_the_weighted_least_squares_solution():
    V = bent(BODY.V) @ rotation(1).T
    A, known = VertexMaps.at_rest(BODY)(V)
    assert known.all()
    for i in range(0, BODY.n, 7):
        np.testing.assert_allclose(A[i], by_lstsq(BODY, V, i), rtol=0, atol=1e-12)


@pytest.mark.parametrize("at_rest", [False, True])
@pytest.mark.parametrize(("mesh", "i"), [(BODY, 30), (strip(8, 5), 0)], ids=["inside", "a corner"])
def test_a_ring_on_a_line_has_the_mean_map_of_its_neighbours(mesh, i, at_rest):
    """Whether it falls onto the line, or lies there at rest, whatever it becomes."""
    ring, rest, V = ring_of(mesh, i), mesh.V.copy(), bent(mesh.V)
    flat = rest if at_rest else V
    flat[ring] = flat[i] + np.linspace(0.1, 1, len(ring))[:, None] * [0.1, 0.2, 0.1]
    A, known = VertexMaps.at_rest(Mesh(rest, mesh.F))(V)
    assert not known[i]
    usable = ring[known[ring]]
    assert len(usable)
    np.testing.assert_allclose(A[i], A[usable].mean(axis=0), rtol=0, atol=1e-12)


def test_coincident_vertices_leave_everything_finite():
    V = BODY.V.copy()
    i, j = BODY.edges[40]
    V[i] = V[j]
    rest, R = Mesh(V, BODY.F), rotation(4)
    A, known = VertexMaps.at_rest(rest)(V @ R.T)
    assert np.isfinite(A).all()
    np.testing.assert_allclose(A, np.broadcast_to(R, A.shape), rtol=0, atol=1e-10)


#: A path 0 - 1 - 2 - 3 - 4, and a separate pair 5 - 6.
PAIRS = np.array([[0, 1], [2, 1], [2, 3], [3, 4], [5, 6]])
KNOWN = np.array([True, False, False, False, True, False, False])


def test_means_spread_ring_by_ring_and_what_nothing_reaches_is_the_identity():
    values = np.random.default_rng(0).normal(size=(7, 3, 3))
    values[2] = np.nan
    before = values.copy()
    filled = fill_from_neighbours(values, KNOWN, pairs=PAIRS)
    assert np.array_equal(filled[[0, 1]], values[[0, 0]]) and np.array_equal(filled[[3, 4]], values[[4, 4]])
    np.testing.assert_allclose(filled[2], 0.5 * (values[0] + values[4]), rtol=1e-15)
    assert np.array_equal(filled[5:], np.stack([np.eye(3)] * 2))
    np.testing.assert_array_equal(values, before)
    assert fill_from_neighbours(values, np.ones(7, dtype=bool), pairs=PAIRS) is values

"""Warps: exact where they must be, as SciPy interpolates, and only where handles determine the shape."""

import tracemalloc

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from sshade import DeformationTask, Handles, InputError, Mesh, Slide, deform
from sshade.mesh.rigid import rigid_motion
from sshade.pipeline.interpolation import fit_splines, interpolate, neighbours
from sshade.pipeline.warp import find_warp
from tests.shapes import bent, beside, block, bumpy, icosphere, rotation, shifted, torus

BODY = Mesh(icosphere(4).V * [2.0, 1.0, 0.7], icosphere(4).F)


def turned(V: np.ndarray) -> np.ndarray:
    return V @ rotation().T + [3.0, 1.0, 2.0]


def task(f, count=400, *, mesh=BODY, seed=0, **changes) -> DeformationTask:
    """Random vertices as handles, moved by a map of space."""
    index = np.random.default_rng(seed).choice(mesh.n, count, replace=False)
    return DeformationTask("warp", mesh, Handles(index, f(mesh.V)[index], **changes))


def off(result, f, mesh=BODY) -> float:
    return float(np.abs(result.vertices - f(mesh.V)).max()) / mesh.diagonal


@pytest.mark.parametrize("f", [turned, lambda V: V * [1.3, 1, 0.8] + V[:, [1, 2, 0]] * [0, 0.2, 0] + 3])
def test_affine_maps_are_exact(f):
    for count in (12, 60, 400):
        assert off(deform(task(f, count), warp="always"), f) < 1e-9


def test_a_spline_is_the_one_of_scipy_and_its_error_at_a_left_out_point_too():
    x = np.random.default_rng(1).uniform(-1, 1, (30, 3))
    y, V = bent(x), np.random.default_rng(2).uniform(-0.7, 0.7, (200, 3))
    every = np.arange(len(x))
    splines = fit_splines(x, y, neighbours(x, every, every))
    oracle = RBFInterpolator(x, y, kernel="cubic", degree=1)(V)
    assert np.abs(interpolate(splines, V, np.ones(len(x)))[0] - oracle).max() < 2e-5
    for point in (0, 7):
        rest = every != point
        without = RBFInterpolator(x[rest], y[rest], kernel="cubic", degree=1)(x[point : point + 1])[0]
        assert splines.left_out[point] == pytest.approx(np.linalg.norm(without - y[point]), rel=1e-6)


def grown(V: np.ndarray) -> np.ndarray:
    return V * (1.05 + 0.05 * np.sin(V[:, :1]))


def test_dense_soft_handles_give_the_volume_alone():
    soft = deform(task(grown, weight=5.0))
    volume = Mesh(grown(BODY.V), BODY.F).volume
    assert Mesh(soft.vertices, BODY.F).volume == pytest.approx(volume, rel=2e-3)
    assert soft.extra["released"] == 1 and soft.extra["proxy_vertices"] > 0 and off(soft, grown) < 0.02


def test_a_goal_of_the_user_comes_first():
    found = deform(task(grown), volume_goal=1.0)
    assert Mesh(found.vertices, BODY.F).volume == pytest.approx(BODY.volume, rel=2e-3)
    with pytest.raises(InputError, match="handles determine the volume of a warp"):
        deform(task(grown), volume_goal=1.0, warp="always")


@pytest.mark.parametrize("method", ["fast", "fine"])
def test_dense_handles_are_not_fought(method):
    dense = task(grown)
    found = deform(dense, method=method)
    assert found.extra["warped"] == 1 and off(found, grown) < 5e-4
    assert off(deform(dense, method=method, warp="never"), grown) > 5e-3
    assert np.array_equal(found.vertices[dense.handles.index], dense.handles.target)


def portion_of(task: DeformationTask) -> float:
    return getattr(find_warp(task, "auto"), "portion", 0.0)


def test_between_dense_and_sparse_the_result_blends():
    portions = [portion_of(task(bent, count)) for count in (10, 16, 24, 40, 80)]
    assert portions[0] < 0.5 and portions[-1] == 1 and any(0 < portion < 1 for portion in portions)
    between = task(bent, (10, 16, 24, 40, 80)[[0 < p < 1 for p in portions].index(True)])
    elastic, mixed, warped = (deform(between, warp=mode) for mode in ("never", "auto", "always"))
    assert mixed.extra["proxy_vertices"] > 0
    assert np.array_equal(mixed.vertices[between.handles.index], between.handles.target)
    assert off(warped, bent) < off(mixed, bent) < off(elastic, bent)


def test_a_component_without_handles_moves_rigidly_where_the_result_blends():
    ball = shifted(Mesh(icosphere(2).V * 0.3, icosphere(2).F), [1, 0, 1])
    handles = task(bent, 20).handles
    both = DeformationTask("ball", beside(BODY, ball), handles, carry_unconstrained=True)
    result = deform(both)
    assert 0 < result.extra["warped"] < 1
    rest, moved = both.mesh.V[BODY.n :], result.vertices[BODY.n :]
    R, t = rigid_motion(rest, moved)
    assert np.abs(rest @ R.T + t - moved).max() < 1e-12


@pytest.mark.parametrize("count", [20, 300])
def test_a_component_that_comes_apart_in_a_warp_is_counted(count):
    flap = Mesh(np.concatenate([BODY.V[[10, 500]], [[0, 0, 2]]]), np.array([[0, 1, 2]]))
    handles = task(bent, count).handles
    result = deform(DeformationTask("flap", beside(BODY, flap), handles, carry_unconstrained=True))
    assert result.extra["warped"] > 0
    assert result.extra["unconstrained"] == result.extra["touching"] == 1
    gap = np.linalg.norm(result.vertices[[10, 500]] - result.vertices[-3:-1], axis=1).max()
    assert result.extra["opening"] == pytest.approx(gap / beside(BODY, flap).diagonal) and gap > 0.001


def test_handles_that_are_hardly_predicted_deform_elastically():
    noise = np.random.default_rng(1).normal(size=(BODY.n, 3))
    portions = []
    for scale in np.geomspace(0.002, 0.1, 14):
        noisy = task(lambda V, scale=scale: bent(V) + scale * noise, 150)
        portions.append(portion_of(noisy))
    assert portions == sorted(portions, reverse=True) and portions[0] == 1
    assert 0.5 < portions[3] < 0.7 and not any(portions[5:])


def test_thousands_of_handles_in_one_place_take_the_memory_of_their_number():
    fine = Mesh(icosphere(6).V * [2.0, 1.0, 0.7], icosphere(6).F)
    index = np.flatnonzero(fine.V[:, 0] > 1.2)[::2]
    assert len(index) > 4000
    crowd = DeformationTask("crowd", fine, Handles(index, bent(fine.V)[index]))
    tracemalloc.start()
    found = find_warp(crowd, "always")
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found is not None and np.array_equal(found.vertices[index], bent(fine.V)[index])
    assert most < 100e6


@pytest.mark.parametrize(("lines", "nearer"), [(3, "never"), (12, "always")])
def test_lines_of_handles_determine_the_shape_only_if_other_lines_predict_them(lines, nearer):
    on_lines = np.abs(BODY.V[:, :1] - np.linspace(-1.9, 1.9, lines)).min(axis=1) < 0.03
    index = np.flatnonzero(on_lines)
    contours = DeformationTask("contours", BODY, Handles(index, bent(BODY.V)[index]))
    assert portion_of(contours) == (1 if nearer == "always" else 0)
    errors = {mode: off(deform(contours, warp=mode), bent) for mode in ("never", "always")}
    assert min(errors, key=errors.__getitem__) == nearer


def ends_and_more(V, index):
    target = V[index].copy()
    target[V[index, 0] > 1] = turned(target[V[index, 0] > 1])
    return Handles(index, target)


@pytest.mark.parametrize(
    "handles",
    [
        lambda V: ends_and_more(V, np.flatnonzero(np.abs(V[:, 0]) > 1.2)),  # regions
        lambda V: ends_and_more(V, np.arange(0, len(V), len(V) // 20)),  # points, one half is turned
        lambda V: Handles(np.arange(300), V[:300] * 1.2, slide=Slide.plane([0, 0, 1])),
        lambda V: Handles(np.arange(300), turned(V[:300])),
    ],
)
def test_other_handles_deform_elastically(handles):
    assert find_warp(DeformationTask("elastic", BODY, handles(BODY.V)), "auto") is None


def test_any_mesh_is_warped():
    ring = torus(40, 20)
    open_ring = Mesh(ring.V, ring.F[:-20])
    bowtie = Mesh(BODY.V, np.concatenate([BODY.F, [[0, 900, 1800]]]))
    thin = BODY.V.copy()
    thin[BODY.F[0, 0]] = thin[BODY.F[0, 1]] + 1e-13
    plate = np.ones((11, 21, 1), dtype=bool)
    plate[1::2, 1::2] = False
    of_genus_50 = Mesh(block(plate).V / 10, block(plate).F)
    assert of_genus_50.topology.euler == 2 - 2 * 50
    for mesh in (open_ring, bowtie, Mesh(thin, BODY.F), bumpy(3), of_genus_50):
        assert off(deform(task(bent, 300, mesh=mesh)), bent, mesh) < 2e-3


def test_flat_handles():
    flat = np.flatnonzero(np.abs(BODY.V[:, 2]) < 1e-12)
    lying = DeformationTask("flat", BODY, Handles(flat, turned(BODY.V)[flat]))
    assert off(deform(lying, warp="always"), turned) < 1e-9


def test_refused():
    with pytest.raises(InputError, match="leave out weights, slides and rotations"):
        deform(task(bent, weight=3.0), warp="always")
    with pytest.raises(InputError, match="a warp needs handles at four places; there are 3"):
        deform(task(bent, 3), warp="always")

"""Invariances of the methods, over random meshes, handles and motions.

The number of iterations is fixed, so that results differ by rounding alone. Coordinates are multiples of
2^-20; shifts and turns by a quarter keep them exact.
"""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baselines.accelerated import local_global
from sshade import DeformationTask, Handles, Mesh, deform
from sshade.proxy import sample as proxy_module
from tests.shapes import bumpy, double_torus, rotation, strip, torus, tube

#: Largest difference of results over the bounding-box diagonal: rounding, amplified by the iterations. The
#: polish keeps its directions in single precision.
ROUNDING = {"paper": 1e-9, "fast": 1e-9, "fine": 6e-8, "interpolate": 1e-9}
#: The same for a scale by a power of two.
SCALED = {"paper": 0.0, "fast": 1e-12, "fine": 1e-12, "interpolate": 1e-12}

SHAPES = [bumpy(2), tube(10, 20), torus(16, 8), strip(20, 5), double_torus(cells=2)]
FIXED = partial(local_global, tolerance=0.0, max_iterations=20, start="rigid")
FEW = {"vertices": 50, "tolerance": 0.0, "max_iterations": 8}  # for each initialisation
METHODS = {
    "paper": partial(deform, method="paper", vertices=50, samplings=2, proxy_method=FIXED),
    "fast": partial(deform, method="fast", **FEW),
    "fine": partial(deform, method="fine", **FEW, polish_iterations=5),
    "interpolate": lambda task, *, seed: deform(task, method="interpolate"),
}

#: Frames and grids follow the axes.
AXES = [("paper", "any turn"), ("interpolate", "any turn"), ("interpolate", "turns by quarters")]
#: Examples of each property: 4, or 100 with --hypothesis-profile=thorough.
EXAMPLES = settings().max_examples // 6
NUMBERS = st.integers(0, 10**6)


def drawn(number: int) -> DeformationTask:
    """A jittered shape with fixed handles, and others that turn and move a little."""
    rng = np.random.default_rng(number)
    shape = SHAPES[number % len(SHAPES)]
    edge = shape.diagonal / np.sqrt(shape.n)
    V = np.round((shape.V + rng.uniform(-0.1, 0.1, shape.V.shape) * edge) * 2**20) / 2**20
    index = rng.permutation(shape.n)[: int(rng.integers(4, 20))]
    fixed = np.arange(len(index)) < len(index) // 2
    turned = V[index] @ rotation(number).T + rng.normal(size=3)
    target = np.where(fixed[:, None], V[index], 0.9 * V[index] + 0.1 * turned)
    return DeformationTask("drawn", Mesh(V, shape.F), Handles(index, target, dynamic=~fixed))


def quarters(rng: np.random.Generator) -> np.ndarray:
    R = np.eye(3)[rng.permutation(3)] * rng.choice([-1.0, 1.0], 3)
    R[:, 2] *= np.linalg.det(R)
    return R


#: Similarities x -> s R x + t, as s, R and t; scales beyond 2^50 underflow in single precision.
SIMILARITIES = {
    "a shift": lambda rng: (1.0, np.eye(3), rng.integers(-(2**24), 2**24, 3) / 2**20),
    "far from the origin": lambda rng: (1.0, np.eye(3), 2.0 ** rng.integers(21, 32) * rng.integers(-1, 2, 3)),
    "turns by quarters": lambda rng: (1.0, quarters(rng), np.zeros(3)),
    "any turn": lambda rng: (1.0, rotation(int(rng.integers(1000))), np.zeros(3)),
    "a power of two": lambda rng: (2.0 ** rng.integers(-50, 51), np.eye(3), np.zeros(3)),
}


def moved(task: DeformationTask, V: np.ndarray, F: np.ndarray, target: np.ndarray) -> DeformationTask:
    handles = task.handles
    moved_handles = Handles(handles.index, target, dynamic=handles.dynamic, group=handles.group)
    return DeformationTask("moved", Mesh(V, F), moved_handles)


def assert_same(found: np.ndarray, expected: np.ndarray, task: DeformationTask, close: float) -> None:
    gap = np.abs(found - expected).max() / task.mesh.diagonal
    assert gap <= close, f"{gap:.1e} of the diagonal apart"


@pytest.mark.parametrize(
    ("name", "kind"), [(m, k) for m in METHODS for k in SIMILARITIES if (m, k) not in AXES]
)
@settings(max_examples=EXAMPLES)
@given(number=NUMBERS, seed=NUMBERS)
def test_results_move_with_the_mesh(name, kind, number, seed):
    s, R, t = SIMILARITIES[kind](np.random.default_rng(seed))
    task = drawn(number)
    result = METHODS[name](task, seed=1).vertices
    V, target = (s * x @ R.T + t for x in (task.mesh.V, task.handles.target))
    there = METHODS[name](moved(task, V, task.mesh.F, target), seed=1).vertices
    # The rounding of coordinates far from the origin grows over the iterations.
    grain = 1e3 * np.abs(t).max() * 2.0**-52 / task.mesh.diagonal
    close = SCALED[name] if kind == "a power of two" else ROUNDING[name] + grain
    assert_same((there - t) @ R / s, result, task, close)


@pytest.mark.parametrize("name", METHODS)
@settings(max_examples=EXAMPLES)
@given(number=NUMBERS)
def test_faces_turned_inside_out(name, number):
    task, method = drawn(number), METHODS[name]
    result = method(task, seed=1).vertices
    there = method(moved(task, task.mesh.V, task.mesh.F[:, ::-1], task.handles.target), seed=1).vertices
    assert_same(there, result, task, ROUNDING[name])


@pytest.mark.parametrize("name", METHODS)
@settings(max_examples=EXAMPLES)
@given(number=NUMBERS, seed=NUMBERS)
def test_vertices_and_faces_in_another_order(name, number, seed):
    """With the same random vertex."""
    task = drawn(number)
    rng, mesh, own = np.random.default_rng(seed), task.mesh, task.handles
    new = rng.permutation(mesh.n)
    V = np.empty_like(mesh.V)
    V[new] = mesh.V
    rolls = zip(new[mesh.F], rng.integers(0, 3, mesh.m), strict=True)
    F = rng.permutation(np.array([np.roll(f, r) for f, r in rolls]))
    handles = Handles(new[own.index], own.target, dynamic=own.dynamic, group=own.group)
    result = METHODS[name](task, seed=1).vertices
    choose = proxy_module._random_other_vertex
    with pytest.MonkeyPatch.context() as patch:
        chosen = lambda n, taken, seed: int(new[choose(n, np.argsort(new)[taken], seed)])  # noqa: E731
        patch.setattr(proxy_module, "_random_other_vertex", chosen)
        there = METHODS[name](DeformationTask("other", Mesh(V, F), handles), seed=1).vertices
    assert_same(there[new], result, task, ROUNDING[name])

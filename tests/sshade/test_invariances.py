"""Invariances of the whole method, over random meshes, handles and motions.

The iterations are fixed in number, so that what is compared differs by rounding
alone. Coordinates are multiples of 2^-20, which shifts and turns by a quarter keep.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sshade import DeformationTask, Handles, Mesh, sshade
from sshade.pipeline.fast import sshade_fast
from sshade.pipeline.fine import sshade_fine
from sshade.sampling import proxy as proxy_module
from sshade.solver.local_global import local_global
from tests.shapes import bumpy, double_torus, rotation, strip, torus, tube

#: Rounding over the bounding-box diagonal, with what 20 iterations make of it. The directions of the polish
#: are kept in single precision: half of its gaps are below 1.2e-10, the largest of 1,600 tasks was 9e-9.
ROUNDING = {"paper": 1e-9, "fast": 1e-9, "fine": 6e-8}
#: What a scale by a power of two may change: no bit, or the last digits (2e-15) of one task in 200.
SCALED = {"paper": 0.0, "fast": 1e-12, "fine": 1e-12}

SHAPES = [bumpy(2), tube(10, 20), torus(16, 8), strip(20, 5), double_torus(cells=2)]
FIXED = partial(local_global, tolerance=0.0, max_iterations=20, start="rigid")
FEW = {"vertices": 50, "tolerance": 0.0, "max_iterations": 8}  # of each start
METHODS = {
    "paper": partial(sshade, vertices=50, samplings=2, coarse=FIXED),
    "fast": partial(sshade_fast, **FEW),
    "fine": partial(sshade_fine, **FEW, polish_iterations=5),
}
#: Their frames do not follow a coordinate of the mesh.
ANY_TURN = ("fast", "fine")

#: Of each property: 4, or 100 with --hypothesis-profile=thorough.
EXAMPLES = settings().max_examples // 6
NUMBERS = st.integers(0, 10**6)
Motion = Callable[[np.ndarray], np.ndarray]


def drawn(number: int) -> DeformationTask:
    """A jittered shape with handles held, and others turned and pulled a little."""
    rng = np.random.default_rng(number)
    shape = SHAPES[number % len(SHAPES)]
    edge = shape.diagonal / np.sqrt(shape.n)
    V = np.round((shape.V + rng.uniform(-0.1, 0.1, shape.V.shape) * edge) * 2**20) / 2**20
    index = rng.permutation(shape.n)[: int(rng.integers(4, 20))]
    held = np.arange(len(index)) < len(index) // 2
    turned = V[index] @ rotation(number).T + rng.normal(size=3)
    target = np.where(held[:, None], V[index], 0.9 * V[index] + 0.1 * turned)
    return DeformationTask("drawn", Mesh(V, shape.F), Handles(index, target, dynamic=~held))


def moved(task: DeformationTask, motion: Motion, *, F: np.ndarray | None = None) -> DeformationTask:
    own = task.handles
    handles = Handles(own.index, motion(own.target), dynamic=own.dynamic, group=own.group)
    return DeformationTask("moved", Mesh(motion(task.mesh.V), task.mesh.F if F is None else F), handles)


def assert_same(found: np.ndarray, expected: np.ndarray, task: DeformationTask, close: float) -> None:
    gap = np.abs(found - expected).max() / task.mesh.diagonal
    assert gap <= close, f"{gap:.1e} of the diagonal apart"


def assert_turns_along(name: str, task: DeformationTask, R: np.ndarray) -> None:
    result = METHODS[name](task, seed=1).vertices
    there = METHODS[name](moved(task, lambda V: V @ R.T), seed=1).vertices
    assert_same(there @ R, result, task, ROUNDING[name])


@pytest.mark.parametrize("name", METHODS)
@settings(max_examples=EXAMPLES)
@given(number=NUMBERS, shift=st.tuples(*[st.integers(-(2**24), 2**24)] * 3))
def test_a_shift(name, number, shift):
    shift = np.array(shift) / 2**20
    task = drawn(number)
    result = METHODS[name](task, seed=1).vertices
    there = METHODS[name](moved(task, lambda V: V + shift), seed=1).vertices
    assert_same(there - shift, result, task, ROUNDING[name])


@pytest.mark.parametrize("name", METHODS)
@settings(max_examples=EXAMPLES)
@given(number=NUMBERS, axes=st.permutations(range(3)), signs=st.tuples(*[st.sampled_from([-1.0, 1.0])] * 2))
def test_a_turn_by_quarters(name, number, axes, signs):
    R = np.eye(3)[axes] * [*signs, 1.0]
    R[:, 2] *= np.linalg.det(R)
    assert_turns_along(name, drawn(number), R)


@pytest.mark.parametrize("name", ANY_TURN)
@settings(max_examples=EXAMPLES)
@given(number=NUMBERS, seed=NUMBERS)
def test_any_turn_where_frames_follow_no_axis(name, number, seed):
    R = rotation(seed)
    assert_turns_along(name, drawn(number), R)


@pytest.mark.parametrize("name", METHODS)
@settings(max_examples=EXAMPLES)
@given(number=NUMBERS, power=st.integers(-50, 50))  # beyond, products of single precision underflow
def test_a_scale_of_a_power_of_two_changes_next_to_no_bit(name, number, power):
    task = drawn(number)
    result = METHODS[name](task, seed=1).vertices
    there = METHODS[name](moved(task, lambda V: V * 2.0**power), seed=1).vertices
    assert_same(there * 2.0**-power, result, task, SCALED[name])


@pytest.mark.parametrize("name", METHODS)
@settings(max_examples=EXAMPLES)
@given(number=NUMBERS)
def test_faces_turned_inside_out(name, number):
    task, method = drawn(number), METHODS[name]
    result = method(task, seed=1).vertices
    there = method(moved(task, lambda V: V, F=task.mesh.F[:, ::-1]), seed=1).vertices
    assert_same(there, result, task, ROUNDING[name])


@pytest.mark.parametrize("name", METHODS)
@settings(max_examples=EXAMPLES)
@given(number=NUMBERS, seed=NUMBERS)
def test_vertices_and_faces_in_another_order(name, number, seed):
    """The vertex that the random choice falls on is that of the other order."""
    task = drawn(number)
    rng, mesh, own = np.random.default_rng(seed), task.mesh, task.handles
    new = rng.permutation(mesh.n)
    V = np.empty_like(mesh.V)
    V[new] = mesh.V
    F = rng.permutation(
        np.array([np.roll(f, r) for f, r in zip(new[mesh.F], rng.integers(0, 3, mesh.m), strict=True)])
    )
    handles = Handles(new[own.index], own.target, dynamic=own.dynamic, group=own.group)
    result = METHODS[name](task, seed=1).vertices
    choose = proxy_module._random_other_vertex
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            proxy_module,
            "_random_other_vertex",
            lambda n, taken, seed: int(new[choose(n, np.argsort(new)[taken], seed)]),
        )
        there = METHODS[name](DeformationTask("other", Mesh(V, F), handles), seed=1).vertices
    assert_same(there[new], result, task, ROUNDING[name])


@pytest.mark.parametrize("name", METHODS)
@settings(max_examples=EXAMPLES)
@given(number=NUMBERS, seed=NUMBERS)
def test_a_seed_gives_the_same_bits_with_any_number_of_workers(name, number, seed):
    task = drawn(number)
    one, two, again = (METHODS[name](task, seed=seed, workers=w).vertices for w in (1, 2, None))
    assert np.array_equal(one, two) and np.array_equal(one, again)


@pytest.mark.parametrize("name", METHODS)
@settings(max_examples=EXAMPLES)
@given(number=NUMBERS, power=st.integers(21, 31), signs=st.tuples(*[st.sampled_from([-1, 0, 1])] * 3))
def test_far_from_the_origin(name, number, power, signs):
    """What the coordinates' own rounding there leaves, times what 20 iterations make of it."""
    shift = 2.0**power * np.array(signs)
    task = drawn(number)
    result = METHODS[name](task, seed=1).vertices
    there = METHODS[name](moved(task, lambda V: V + shift), seed=1).vertices
    grain = 2.0 ** (power - 52) / task.mesh.diagonal
    assert_same(there - shift, result, task, ROUNDING[name] + 1e3 * grain)

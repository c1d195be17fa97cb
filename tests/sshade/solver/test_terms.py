"""Every term of the energy: its forces are its gradient, its matrix bounds its curvature in both orders.

A new term in :data:`sshade.solver.terms.TERMS` needs its definition in :func:`defined`, and nothing else.
"""

from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import diags_array
from scipy.spatial.transform import Rotation

from sshade.mesh.boxes import opposite_vertices
from sshade.problem.options import Options, described
from sshade.solver import laplacian
from sshade.solver.aim import Aim
from sshade.solver.laplacian import edge_weights, half_cotangents, laplacian_matrix
from sshade.solver.ordered_mesh import BoundHandles, OrderedMesh
from sshade.solver.system import System, assembled
from sshade.solver.terms import TERMS, Arap
from sshade.solver.terms.bending import bending_stiffness
from tests.shapes import bumpy, jittered, rotation, strip
from tests.sshade.naive import vertex_areas

MESH = jittered(bumpy(3), 0.02)
#: Four groups at the ends of two axes; three of them stay, and some handles are soft.
GROUPS = [np.argsort(sign * MESH.V[:, axis])[:6] for axis in (0, 2) for sign in (1, -1)]
INDEX = np.concatenate(GROUPS)
TARGET = MESH.V[INDEX] + (np.arange(24) >= 18)[:, None] * np.array([0.3, 0.1, 0.4])
STIFFNESS = np.where(np.arange(len(INDEX)) % 3 == 0, 0.7, np.inf)
#: Terms, options beside their own, and elements. Softening is a variant of the first term.
CASES = [(term, {}, kind) for term in TERMS for kind in ("spokes_and_rims", "spokes")]
CASES += [(Arap, {"stiffness": 0.3, "strain": 0.05}, "spokes_and_rims")]
#: Terms whose matrix is a bound alone.
BOUNDED = ("Struts",)
#: Number of vertices in a range; the mesh has several.
RANGE = 200


def on(term, options: dict) -> Options:
    """Return options that turn a term on, by an ordinary weight."""
    interval = described()[term.option].interval
    return Options(**({term.option: 0.3} if interval.startswith("[0") else {}) | options)


@pytest.fixture(params=CASES, ids=lambda case: " ".join([case[0].__name__, *case[1], case[2]]))
def case(request, monkeypatch):
    """A term in a solve, at random positions and rotations."""
    kind, changes, elements = request.param
    options = on(kind, changes)
    monkeypatch.setattr(laplacian, "CHUNK", RANGE)
    ordered = OrderedMesh(MESH, elements)
    assert len(ordered.ranges) > 2
    bound = kind.bound(ordered, BoundHandles.of(ordered, INDEX, STIFFNESS), options)
    assert bound is not None, f"{kind.__name__} stays off with {options}"
    term = bound.begun(options)
    term.aim(Aim(TARGET, fraction=np.ones(len(INDEX))))
    rng = np.random.default_rng(0)
    P = ordered.V - MESH.origin + 0.05 * rng.normal(size=(MESH.n, 3))
    R = Rotation.from_rotvec(0.3 * rng.normal(size=(MESH.n, 3))).as_matrix().reshape(-1, 9)
    facts = {"kind": kind, "options": options, "elements": elements, "bound": bound, "term": term}
    return SimpleNamespace(ordered=ordered, P=P, R=R, **facts)


def evaluated(case, P: np.ndarray, R: np.ndarray) -> SimpleNamespace:
    """Return the energy at P and R by both methods of a term, and the forces.

    The first term overwrites covariances and forces; other terms add to those that are there.
    """
    ranges, first = range(len(case.ordered.ranges)), case.kind is TERMS[0]
    S0 = np.random.default_rng(2).normal(size=(MESH.n, 9))
    B0 = np.random.default_rng(3).normal(size=(MESH.n, 3))
    S, B = S0.copy(), B0.copy()
    fitted = sum(case.term.local(number, P, S) for number in ranges)
    S = S if first else S - S0
    trace = np.einsum("nij,nji->", R.reshape(-1, 3, 3), S.reshape(-1, 3, 3))
    for number in ranges:
        case.term.turn(number, R)
    direct = sum(case.term.forces(number, P, R, B) for number in ranges)
    B = B if first else B - B0
    quadratic = fitted - 2 * trace + case.term.rest_energy
    energy = direct if getattr(case.term, "weight", None) is not None else quadratic
    return SimpleNamespace(energy=energy, quadratic=quadratic, direct=direct, B=B)


def penalty(x: np.ndarray, stiffness: float, strain: float, limit: float) -> np.ndarray:
    """Return the softened energy of relative energies x."""
    huber = 2 * strain**2 * (np.sqrt(1 + x / strain**2) - 1)
    return stiffness * x + (1 - stiffness) * (huber + x * (1 - 1 / np.sqrt(1 + x**2 / limit**4)))


def defined(case, P: np.ndarray, R: np.ndarray) -> float:
    """Return the energy of a term from its definition, in the order of the mesh."""
    place, options, area = case.ordered.place, case.options, vertex_areas(MESH)
    P, R, V, F, h = P[place] + MESH.origin, R[place].reshape(-1, 3, 3), MESH.V, MESH.F, half_cotangents(MESH)
    corners = case.ordered.corners
    if case.kind is Arap:
        total = np.zeros(MESH.m)
        for c, (i, j) in product(range(3), [(0, 1), (1, 2), (2, 0)]):
            if case.elements == "spokes" and c not in (i, j):
                continue
            turned = np.einsum("tab,tb->ta", R[F[:, c]], V[F[:, i]] - V[F[:, j]])
            total += h[:, i] * ((P[F[:, i]] - P[F[:, j]] - turned) ** 2).sum(axis=1)
        rest = 6 * MESH.face_areas
        soft = options.stiffness, options.strain, options.strain_limit
        return float((rest * penalty(total / rest, *soft)).sum())
    if case.kind.__name__ == "Pulls":
        soft = np.isfinite(STIFFNESS)
        return corners * float((STIFFNESS[soft] * ((P[INDEX] - TARGET) ** 2).sum(axis=1)[soft]).sum())
    if case.kind.__name__ == "Struts":
        i, j = opposite_vertices(MESH)
        off = P[i] - P[j] - np.einsum("pab,pb->pa", R[i], V[i] - V[j])
        length = np.linalg.norm(V[i] - V[j], axis=1)
        return corners * float((options.thickness * area[i] / length**2 * (off**2).sum(axis=1)).sum())
    assert case.kind.__name__ == "Bending", "a new term needs its definition here"
    L = laplacian_matrix(MESH.n, *edge_weights(MESH, h))
    hard = np.isin(np.arange(MESH.n), INDEX[np.isinf(STIFFNESS)])
    off = L @ P - np.einsum("iab,ib->ia", R, L @ V)
    free = abs(L) @ ~hard > 0  # vertices around which all is held have no energy
    return corners * float((options.bending**2 * MESH.area / area * (off**2).sum(axis=1))[free].sum())


def test_boundaries_do_not_resist_bending():
    sheet = jittered(strip(8, 6), 0.1)
    L = laplacian_matrix(sheet.n, *edge_weights(sheet, half_cotangents(sheet)))
    stiffness = bending_stiffness(sheet, L, np.array([0]), 1.0)
    assert np.array_equal(np.flatnonzero(stiffness == 0), np.unique(sheet.boundary_edges))


def as_matrix(term, order: str):
    matrix = term.matrix(order)
    return diags_array(matrix).tocsr() if matrix.ndim == 1 else matrix


def directions(count: int = 4) -> np.ndarray:
    return np.random.default_rng(1).normal(size=(count, MESH.n, 3))


def test_the_forces_are_the_gradient_of_the_energy(case):
    B, corners, h = evaluated(case, case.P, case.R).B, case.ordered.corners, 1e-5
    for D in directions():
        up, down = (evaluated(case, case.P + sign * h * D, case.R).energy for sign in (1, -1))
        slope = (up - down) / (2 * h)
        assert slope == pytest.approx(-2 * corners * float((B * D).sum()), rel=1e-5, abs=1e-7)
    assert np.abs(B).max() > 1e-6


@pytest.mark.parametrize("limit", [np.inf, 0.12])
def test_the_energy_is_that_of_the_definition(case, limit):
    case.options = replace(case.options, strain_limit=limit)
    case.term = case.bound.begun(case.options)
    case.term.aim(Aim(TARGET))
    assert evaluated(case, case.P, case.R).energy == pytest.approx(defined(case, case.P, case.R), rel=1e-9)


def test_both_methods_give_one_energy(case):
    found = evaluated(case, case.P, case.R)
    if case.kind is Arap:  # without strain weights it returns 0, and with them the quadratic energy is larger
        assert found.direct <= found.quadratic
    else:
        assert found.direct == pytest.approx(found.quadratic, rel=1e-9)


def test_the_matrix_bounds_the_energy(case):
    """The bound holds for steps of any length; for a quadratic term it is the energy itself."""
    here, corners, M = evaluated(case, case.P, case.R), case.ordered.corners, as_matrix(case.bound, "solver")
    exact = case.kind.__name__ not in BOUNDED and getattr(case.term, "weight", None) is None
    for length, D in zip((1e-2, 0.1, 1.0, 10.0), directions(), strict=True):
        D = length * D
        square, linear = corners * float((D * (M @ D)).sum()), 2 * corners * float((D * here.B).sum())
        there, slack = evaluated(case, case.P + D, case.R).energy, 1e-9 * (1 + abs(here.energy) + abs(square))
        assert there <= here.energy + 2 * square - linear + slack
        if exact:
            assert there == pytest.approx(here.energy + square - linear, abs=slack)


def test_the_matrix_has_one_content_in_both_orders(case):
    mesh, solver = (as_matrix(case.bound, order) for order in ("mesh", "solver"))
    place = case.ordered.place
    assert abs(solver).max() > 0
    assert abs(mesh - solver[place][:, place]).max() <= 1e-12 * abs(solver).max()
    system = System(MESH, INDEX, on(case.kind, {}), elements=case.elements, stiffness=STIFFNESS)
    assert case.kind in map(type, system.terms)
    for order in ("mesh", "solver"):
        without = [term for term in system.terms if type(term) is not case.kind]
        if case.kind is not Arap:
            rest = assembled(system.terms, order) - assembled(without, order)
            assert abs(rest - (mesh if order == "mesh" else solver)).max() <= 1e-9 * abs(solver).max()


def test_a_rigid_motion_keeps_the_energy_of_terms_that_say_so(case):
    Q, t = rotation(7), np.array([0.3, -0.2, 0.5])
    turned = np.einsum("ab,nbc->nac", Q, case.R.reshape(-1, 3, 3)).reshape(-1, 9)
    before = evaluated(case, case.P, case.R).energy
    after = evaluated(case, case.P @ Q.T + t, np.ascontiguousarray(turned)).energy
    assert (after == pytest.approx(before, rel=1e-9)) == case.kind.rigid


def test_two_solves_of_one_term_share_no_state(case):
    before = evaluated(case, case.P, case.R)
    other = SimpleNamespace(**vars(case) | {"term": case.bound.begun(on(case.kind, {}))})
    other.term.aim(Aim(TARGET + 1.0, fraction=np.full(len(INDEX), 0.5)))
    evaluated(other, 2.0 * case.P, case.R)
    after = evaluated(case, case.P, case.R)
    assert before.energy == after.energy and np.array_equal(before.B, after.B)

"""Meshes of several components: each component deforms as if alone, and junctions stay closed.

Other tests check components without handles and the division of the proxy vertices.
"""

import logging
from dataclasses import replace
from functools import partial
from itertools import count

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from baselines.arap import elastic
from sshade import DeformationResult, DeformationTask, Handles, Mesh
from sshade.method.assembly import Components
from tests.shapes import QUARTER, beside, bumpy, end_handles, of_all, rotation, shifted, strip
from tests.sshade.mesh.test_cutting import klein_bottle, moebius, t_fin, with_fin
from tests.sshade.method.calls import fast, fine, paper

BODY = bumpy(2)
METHOD = partial(paper, samplings=2)


def deformed(mesh, handles, method, **options) -> DeformationResult:
    return method(DeformationTask("m", mesh, handles), **options)


def ends(mesh: Mesh, *, lift=(0.3, 0.0, 0.2)) -> Handles:
    return end_handles(mesh.V, count=8, shift=lift)


PAIR = beside(BODY, shifted(BODY, 9))
OF_PAIR = of_all((ends(BODY), 0), (ends(shifted(BODY, 9)), BODY.n))


@pytest.mark.parametrize(("asked", "shares"), [(150, (40, 40)), (50, (20, 30))])
def test_two_spheres_are_each_as_alone(asked, shares):
    """Proxy vertices are divided by area.

    Each sphere gets at least 4 proxy vertices more than handles, and at most a quarter of its vertices.
    """
    small, large = Mesh(0.5 * BODY.V + [4, 0, 0], BODY.F), Mesh(BODY.V, BODY.F[:, [1, 2, 0]])
    own_small, own_large = ends(small), ends(large, lift=(0, 0.4, 0))
    mesh, handles = beside(small, large), of_all((own_small, 0), (own_large, BODY.n))
    stages = set()
    more = {"vertices": asked, "progress": lambda stage, *_: stages.add(stage)}
    result = deformed(mesh, handles, METHOD, seed=1, **more)
    assert stages == {f"component {c}/2, proxy {p}" for c in (1, 2) for p in (1, 2)}
    for k, (part, own) in enumerate(((small, own_small), (large, own_large))):
        rows = slice(k * BODY.n, (k + 1) * BODY.n)
        options = {"vertices": shares[k], "seed": 1}
        alone = METHOD(DeformationTask("alone", part, own), **options)
        assert np.array_equal(result.vertices[rows], alone.vertices)
    assert result.facts.components == 2
    assert result.facts.samples == result.facts.proxy_vertices == sum(shares)
    assert set(result.seconds) >= {"remesh", "bind", "solve", "carry"}


@pytest.mark.parametrize("method", [METHOD, fast])
def test_components_whose_handles_move_rigidly_move_with_them(method):
    R = rotation(2)
    own = ends(BODY)
    turned = Handles(own.index, BODY.V[own.index] @ R.T + [9, 0, 1])
    one = Handles([5], BODY.V[[5]] + [9, 1, 0])
    result = deformed(beside(BODY, BODY), of_all((turned, 0), (one, BODY.n)), method)
    expected = np.concatenate([BODY.V @ R.T + [9, 0, 1], BODY.V + [9, 1, 0]])
    assert np.abs(result.vertices - expected).max() < 1e-12
    assert result.facts.rigid == 2 and result.facts.samples == 0 and result.facts.options


def pages(*angles: float, width: int = 8) -> tuple[Mesh, np.ndarray]:
    """Return sheets that meet at a line with angles in degrees, and the vertex ids of each sheet."""
    sheet = strip(width, 2 * width)
    line, n = 2 * width + 1, sheet.n
    number = np.arange(n) + (np.arange(n) >= line) * np.arange(len(angles))[:, None] * (n - line)
    V = np.empty((number.max() + 1, 3))
    for ids, angle in zip(number, np.radians(angles), strict=True):
        x, y, _ = sheet.V.T
        V[ids] = np.stack([x * np.cos(angle), y, x * np.sin(angle)], axis=1)
    F = [ids[sheet.F if angle < 180 else sheet.F[:, ::-1]] for ids, angle in zip(number, angles, strict=True)]
    return Mesh(V, np.concatenate(F)), number.reshape(len(angles), width + 1, -1)


@pytest.mark.parametrize("angles", [(0, 180, 90), (0, 90, 180, 270)])
@pytest.mark.parametrize("held", [1, -1], ids=["one sheet", "all other sheets"])
def test_sheets_that_meet_at_an_edge_stretch_little_more_than_in_one_solve(angles, held):
    """The reference is one solve of all sheets by libigl, which needs no manifold. The gap is zero."""
    mesh, number = pages(*angles)
    still, moved, a = number[:held, -1].ravel(), number[-1, -1], np.radians(angles[-1])
    shift = 2.4 * np.array([np.cos(a), 0, np.sin(a)]) + 3.2 * np.array([-np.sin(a), 0, np.cos(a)])
    target = np.concatenate([mesh.V[still], mesh.V[moved] + shift])
    own = Handles(np.concatenate([still, moved]), target, group=np.repeat([0, 1], [len(still), len(moved)]))
    reference = stretch(mesh, elastic(DeformationTask("m", mesh, own), start="rigid").vertices)
    for method in (fast, fine):
        result = deformed(mesh, own, method)
        assert stretch(mesh, result.vertices).max() < 1.2 * reference.max()
        assert result.facts.gap == 0 and result.facts.copies == 17
        assert np.array_equal(result.vertices[own.index], own.target)


def test_junctions_are_placed_with_many_small_components_and_with_one_that_has_handles_alone():
    """The mesh has 200 random triangles on 60 vertices, and all triangles are joined."""
    rng = np.random.default_rng(0)
    F = np.array([rng.permutation(60)[:3] for _ in range(200)])
    mesh = Mesh(rng.random((60, 3)), F)
    R = rotation(3)
    for handles in (F[0], np.arange(50)):
        own = Handles(handles, mesh.V[handles] @ R.T + [1, 2, 3])
        result = deformed(mesh, own, fast)
        assert np.abs(result.vertices - mesh.V @ R.T - [1, 2, 3]).max() < 1e-3 and result.facts.gap < 1e-6


def bowtie() -> Mesh:
    """A strip whose first vertex is also its last."""
    sheet = strip(10, 4)
    return Mesh(sheet.V[:-1], np.where(sheet.n - 1 == sheet.F, 0, sheet.F))


@pytest.mark.parametrize("weight", [np.inf, 2.0])
def test_copies_within_a_component_meet_at_one_place(weight):
    mesh = bowtie()
    own = Handles([2, 0], mesh.V[[2, 0]] * 1.1 + [0, 0, 1], weight=[np.inf, weight])
    result = deformed(mesh, own, fast)
    assert result.facts.copies == 1 and result.facts.gap < 1e-12
    assert np.array_equal(result.vertices[0], own.target[1]) == np.isinf(weight)


def test_a_surface_that_meets_itself_in_a_point_bends_on_a_coarse_proxy():
    """Faces of the proxy join two copies of the point, and are no faces where it is one vertex."""
    sheet, one, other = strip(24, 8), 112, 130
    V, F = np.array(sheet.V), np.where(other == sheet.F, one, sheet.F)
    V[one] = (V[one] + V[other]) / 2 + [0, 0, 0.3]
    mesh = Mesh(np.delete(V, other, axis=0), F - (other < F))
    own = end_handles(mesh.V, axis=0, share=0.05, shift=[0, 0, 4])
    result = deformed(mesh, own, fast, vertices=40)
    assert result.facts.copies == 1 and result.facts.gap < 1e-12
    assert np.array_equal(result.vertices[own.index], own.target)


def test_sides_in_different_minima_meet_from_their_mean(monkeypatch):
    mesh, guesses = moebius(), []

    def apart_at_first(piece, task, **_):
        guesses.append(task.guess)
        apart = 2.0 * (np.arange(2 * mesh.n) >= mesh.n) * (task.guess is None)
        return DeformationResult(piece.mesh.V + np.outer(apart, [1, 0, 0]), iterations=3, converged=True)

    monkeypatch.setattr("sshade.method.piece.Piece.deform", apart_at_first)
    result = deformed(mesh, Handles([2, 7], mesh.V[[2, 7]] * 1.1), paper)
    assert guesses[0] is None and np.allclose(guesses[1], np.tile(mesh.V, (2, 1)) + [1, 0, 0])
    assert np.array_equal(result.vertices, mesh.V) and result.facts.side_gap == 0


def test_components_go_by_size_and_the_largest_gap_of_all_is_told(monkeypatch):
    """The second of three pieces misses the first one by 0.3."""
    sizes = [shifted(Mesh(size * BODY.V, BODY.F), [9 * k, 0, 0]) for k, size in enumerate((1.0, 3.0, 2.0))]
    assert Components(beside(*sizes), BODY.n * np.arange(3)).order == [1, 2, 0]
    mesh, calls = strip(10, 4), count()
    for row in (1, 3):
        mesh = with_fin(mesh, 5 * np.arange(11) + row, np.outer([1, 2], [0, 0, 1]))

    def missing(piece, task, **_):
        shift = [0.3 * (next(calls) == 1), 0, 0]
        return DeformationResult(piece.mesh.V + shift, iterations=1, converged=True)

    monkeypatch.setattr("sshade.method.piece.Piece.deform", missing)
    result = deformed(mesh, Handles([0, 54], mesh.V[[0, 54]]), paper)
    assert result.facts.gap * mesh.diagonal == pytest.approx(0.3)


@pytest.mark.parametrize("method", [fast, fine, paper])
@pytest.mark.parametrize("mesh", [moebius(120), klein_bottle()])
def test_one_sided_surfaces_are_not_torn(mesh, method, caplog):
    own = end_handles(mesh.V, axis=1, count=12, shift=(0.4, 0, 0.3), turn=QUARTER)
    with caplog.at_level(logging.WARNING):
        result = deformed(mesh, own, method)
    assert stretch(mesh, result.vertices).max() < 1.7  # 2.9 to 15 if the surface is cut
    assert result.facts.one_sided == mesh.n and result.facts.copies == result.facts.turned == 0
    # More attachment on the proxy draws the sides of the bottle into different minima.
    assert 0 < result.facts.side_gap < (0.1 if method is fine else 0.03) and result.facts.gap == 0
    expected = ["the volume is not kept: the surface has one side"] if method is not paper else []
    assert caplog.messages == expected


def test_soft_handles_pull_a_one_sided_surface_as_strongly_as_its_elastic_energy_resists():
    """Compare a band with one half turn and a band of the same shape and size with two half turns."""
    yields = []
    for mesh in (moebius(60), moebius(60, half_turns=2)):
        own = end_handles(mesh.V, axis=0, count=9, shift=(0.4, 0, 0))
        moved = replace(own, weight=np.where(own.dynamic, 0.3, np.inf))
        V = deformed(mesh, moved, fine).vertices
        pulled = own.index[own.dynamic]
        yields.append((V - mesh.V)[pulled, 0].mean())
    assert 0.01 < yields[0] < 0.39 and yields[0] == pytest.approx(yields[1], rel=0.25)


def stretch(mesh: Mesh, V: np.ndarray) -> np.ndarray:
    """Return the length of every edge as a multiple of its length at rest."""
    now, rest = (np.linalg.norm(X[mesh.edges[:, 0]] - X[mesh.edges[:, 1]], axis=1) for X in (V, mesh.V))
    return now / rest


def three() -> tuple[Mesh, Handles]:
    """Return two bodies with handles, and a fin, which is cut, in the moved end of the first body."""
    other = shifted(BODY, [9, 0, 0])
    fin = t_fin()
    top = BODY.V[np.argmax(BODY.V[:, 2])]
    mesh = beside(BODY, other, Mesh(0.02 * (fin.V - fin.V.mean(axis=0)) + 0.95 * top, fin.F))
    return mesh, of_all((ends(BODY), 0), (ends(other, lift=(0, 0, 0)), BODY.n))


def test_or_it_follows_the_nearest_component_rigidly():
    mesh, own = three()
    result = deformed(mesh, own, METHOD, vertices=80)
    assert result.facts.unconstrained == 1 and result.facts.components == 2
    rest, moved = mesh.V[2 * BODY.n :], result.vertices[2 * BODY.n :]
    assert np.allclose(pdist(moved), pdist(rest), atol=1e-12)
    # The fin follows the end around it, whose handles move by (0.3, 0, 0.2). The second body stays.
    assert np.abs((moved - rest).mean(axis=0) - [0.3, 0, 0.2]).max() < 0.05
    without = deformed(Mesh(mesh.V[: 2 * BODY.n], mesh.F[: 2 * BODY.m]), own, METHOD, vertices=80)
    assert np.array_equal(result.vertices[: 2 * BODY.n], without.vertices)


@pytest.mark.parametrize("turned", [False, True])
def test_a_face_that_is_there_twice_changes_nothing(turned):
    """The copies may have reversed orientation, and a face may have several copies."""
    copies = BODY.F[[3, 3, 77]][:, ::-1] if turned else BODY.F[[3, 3, 77]]
    twice = Mesh(BODY.V, np.concatenate([BODY.F[:50], copies, BODY.F[50:]]))
    one, other = (deformed(mesh, ends(mesh), METHOD, vertices=60) for mesh in (BODY, twice))
    assert np.array_equal(one.vertices, other.vertices)
    assert other.facts.duplicates == 3 and other.facts.copies == 0 and one.facts.duplicates == 0

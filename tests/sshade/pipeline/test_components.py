"""Component by component: each as it is alone, seams that stay closed, unconstrained ones, and shares."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from sshade import DeformationResult, DeformationTask, Handles, InputError, Mesh
from sshade.options import Options
from sshade.pipeline.components import by_components
from sshade.progress import silent
from tests.shapes import beside, block, bumpy, end_handles, icosphere, rotation, shifted, strip
from tests.sshade.mesh.test_cutting import moebius, t_fin
from tests.sshade.pipeline.calls import fast, fine, paper

BODY = bumpy(2)
METHOD = partial(paper, samplings=2)


def deformed(mesh, handles, method, *, carry_unconstrained=False, **options) -> DeformationResult:
    return method(DeformationTask("m", mesh, handles, carry_unconstrained=carry_unconstrained), **options)


def ends(mesh: Mesh, *, lift=(0.3, 0.0, 0.2)) -> Handles:
    return end_handles(mesh.V, count=8, shift=lift)


def of_all(*given: tuple[Handles, int]) -> Handles:
    """Handles of several meshes, with what is to be added to their ids."""
    return Handles(
        np.concatenate([handles.index + offset for handles, offset in given]),
        np.concatenate([handles.target for handles, _ in given]),
        dynamic=np.concatenate([handles.dynamic for handles, _ in given]),
        group=np.concatenate([handles.group + 2 * i for i, (handles, _) in enumerate(given)]),
    )


PAIR = beside(BODY, shifted(BODY, 9))
OF_PAIR = of_all((ends(BODY), 0), (ends(shifted(BODY, 9)), BODY.n))


@pytest.mark.parametrize("method", [paper, fast, fine])
def test_a_component_beside_an_unconstrained_one_is_as_alone(method):
    task = DeformationTask("body", BODY, ends(BODY))
    assert "components" not in method(task, vertices=60, seed=3).extra
    both = deformed(PAIR, ends(BODY), method, carry_unconstrained=True)
    alone = method(task, vertices=6000)
    assert np.array_equal(both.vertices[: BODY.n], alone.vertices) and both.extra["unconstrained"] == 1


def test_two_spheres_are_each_as_alone():
    """Shares go by area, a quarter at most; the small one comes first in the file, and keeps its place."""
    small, large = Mesh(0.5 * BODY.V + [4, 0, 0], BODY.F), Mesh(BODY.V, BODY.F[:, [1, 2, 0]])
    own_small, own_large = ends(small), ends(large, lift=(0, 0.4, 0))
    stages = set()
    result = deformed(
        beside(small, large),
        of_all((own_small, 0), (own_large, BODY.n)),
        METHOD,
        vertices=150,
        seed=1,
        progress=lambda stage, *_: stages.add(stage),
    )
    assert stages == {f"component {c}/2, proxy {p}" for c in (1, 2) for p in (1, 2)}
    for mesh, own, share, part in (
        (small, own_small, 20, result.vertices[: BODY.n]),
        (large, own_large, 40, result.vertices[BODY.n :]),
    ):
        alone = METHOD(DeformationTask("alone", mesh, own), vertices=share, seed=1)
        assert np.array_equal(part, alone.vertices)
    assert result.extra["components"] == 2 and result.extra["samples"] == result.extra["proxy_vertices"] == 60
    assert set(result.seconds) >= {"remesh", "bind", "solve", "carry"}


def test_a_small_component_has_proxy_vertices_for_its_handles_and_some_more():
    tiny = Mesh(0.01 * BODY.V + [4, 0, 0], BODY.F)
    shares = []

    def spy(task, *, vertices, **settings):
        shares.append((task.mesh.n, len(task.handles), vertices))
        return METHOD(task, vertices=vertices, **settings)

    triangle = Mesh(0.1 * np.eye(3) + [0, 9, 0], [[0, 1, 2]])
    mesh = beside(BODY, tiny, triangle)
    own = of_all((ends(BODY), 0), (ends(tiny), BODY.n), (Handles([0, 1], triangle.V[:2] + 1), 2 * BODY.n))
    result = by_components(DeformationTask("m", mesh, own), spy, Options(vertices=100), progress=silent)
    assert shares == [(162, 16, 40), (3, 2, 3), (162, 16, 20)]
    assert np.allclose(result.vertices[-3:-1], triangle.V[:2] + 1, atol=1e-9)


def test_a_fin_follows_what_it_stands_on():
    mesh = t_fin(4)
    base = strip(10, 4)
    corners = np.array([0, 4, 50, 54])
    own = Handles(corners, base.V[corners] + np.outer([0, 0, 1, 1], [-2.0, 0, 3]), dynamic=[0, 0, 1, 1])
    result = deformed(mesh, own, METHOD, vertices=60)
    share = round(mesh.n // 4 * base.area / mesh.area)
    alone = METHOD(DeformationTask("base", base, own), vertices=share, seed=0)
    assert np.array_equal(result.vertices[: base.n], alone.vertices)
    assert result.extra["components"] == 2 and result.extra["copies"] == 11
    # The fin still stands on its line, about as high as before, and was bent along.
    fin = result.vertices[base.n :].reshape(4, 11, 3)
    seam = result.vertices[5 * np.arange(11) + 2]
    steps = np.linalg.norm(np.diff(np.concatenate([seam[None], fin]), axis=0), axis=2)
    assert steps.min() > 0.6 and steps.max() < 1.6
    assert np.abs(fin[-1] - mesh.V[base.n :].reshape(4, 11, 3)[-1]).max() > 1
    assert result.extra["gap"] * mesh.diagonal < 0.15


def test_rigid_handles_move_what_was_cut_rigidly():
    R, shift = rotation(4), np.array([0.3, -1, 2])
    edge = np.zeros((2, 2, 1))
    edge[0, 0] = edge[1, 1] = 1
    # The tolerance of the solver, where it has to iterate.
    for mesh, close in ((t_fin(), 1e-9), (block(edge, cells=3), 1e-3), (moebius(), 1e-9)):
        own = Handles(np.arange(0, mesh.n, 9), mesh.V[::9] @ R.T + shift)
        result = deformed(mesh, own, partial(fast, start="rigid"), vertices=min(60, mesh.n))
        assert np.abs(result.vertices - mesh.V @ R.T - shift).max() < close * mesh.diagonal
        assert result.extra["gap"] < close


def test_copies_within_a_component_are_joined_at_their_mean():
    mesh = moebius()

    def torn(task, *, vertices, progress):
        """Move every vertex by its number."""
        V = task.mesh.V + [[1, 0, 0]] * np.arange(task.mesh.n)[:, None]
        return DeformationResult(V, iterations=3, converged=None)

    task = DeformationTask("m", mesh, Handles([0], mesh.V[:1]))
    result = by_components(task, torn, Options(vertices=20), progress=silent)
    copies, n = result.extra["copies"], mesh.n
    moved = (result.vertices - mesh.V)[:, 0]
    split = np.flatnonzero(np.abs(moved - np.arange(n)) > 1e-9)
    assert len(split) == copies > 0
    # Of a vertex and its copy, numbered n, n + 1, ... in the order of the vertices.
    assert np.allclose(moved[split], (split + n + np.arange(copies)) / 2)
    assert result.extra["gap"] == pytest.approx(((n + np.arange(copies) - split) / 2).max() / mesh.diagonal)
    assert result.converged is None and result.iterations == 3


def three() -> tuple[Mesh, Handles]:
    """Two bodies with handles, and a ball in the moved end of the first."""
    other = shifted(BODY, [9, 0, 0])
    eye = icosphere(1)
    top = BODY.V[np.argmax(BODY.V[:, 2])]
    mesh = beside(BODY, other, Mesh(0.05 * eye.V + 0.95 * top, eye.F))
    return mesh, of_all((ends(BODY), 0), (ends(other, lift=(0, 0, 0)), BODY.n))


def test_a_component_without_handles_is_refused_by_its_size_and_place():
    mesh, own = three()
    with pytest.raises(
        InputError,
        match=r"1 of the mesh's 3 components have no handle \(the first has 42 vertices, one of them 324\)",
    ):
        deformed(mesh, own, METHOD, vertices=80)


def test_or_it_follows_the_nearest_component_rigidly():
    mesh, own = three()
    result = deformed(mesh, own, METHOD, vertices=80, carry_unconstrained=True)
    assert result.extra["unconstrained"] == 1 and result.extra["components"] == 2
    rest, moved = mesh.V[2 * BODY.n :], result.vertices[2 * BODY.n :]
    assert np.allclose(pdist(moved), pdist(rest), atol=1e-12)
    # With the end that it is in, whose handles go by (0.3, 0, 0.2); the other body stays.
    assert np.abs((moved - rest).mean(axis=0) - [0.3, 0, 0.2]).max() < 0.05
    without = deformed(Mesh(mesh.V[: 2 * BODY.n], mesh.F[: 2 * BODY.m]), own, METHOD, vertices=80)
    assert np.array_equal(result.vertices[: 2 * BODY.n], without.vertices)


def test_an_unconstrained_component_that_was_cut_stays_together():
    mesh, fin = BODY, t_fin()
    fin = Mesh(0.02 * fin.V + BODY.V[np.argmax(BODY.V[:, 2])], fin.F)
    result = deformed(beside(mesh, fin), ends(mesh), METHOD, vertices=60, carry_unconstrained=True)
    rest, moved = fin.V, result.vertices[mesh.n :]
    assert np.allclose(pdist(moved), pdist(rest), atol=1e-12) and result.extra["unconstrained"] == 1


def test_a_proxy_without_room_for_the_handles_of_all_is_refused():
    with pytest.raises(InputError, match="at least 32 are needed, to hold the 32 handle vertices"):
        deformed(PAIR, OF_PAIR, METHOD, vertices=10)


def test_a_component_that_fails_is_named():
    point = Mesh(0 * BODY.V + [5, 0, 0], BODY.F)
    mesh, own = beside(BODY, point), of_all((ends(BODY), 0), (ends(point), BODY.n))
    words = "the component of 162 vertices around vertex 162 cannot be deformed: all vertices .* coincide"
    with pytest.raises(InputError, match=words):
        deformed(mesh, own, METHOD, vertices=100)


@pytest.mark.parametrize("turned", [False, True])
def test_a_face_that_is_there_twice_changes_nothing(turned):
    """Also where the copy turns the other way, and where there are several."""
    copies = BODY.F[[3, 3, 77]][:, ::-1] if turned else BODY.F[[3, 3, 77]]
    twice = Mesh(BODY.V, np.concatenate([BODY.F[:50], copies, BODY.F[50:]]))
    one, other = (deformed(mesh, ends(mesh), METHOD, vertices=60) for mesh in (BODY, twice))
    assert np.array_equal(one.vertices, other.vertices)
    assert other.extra["duplicates"] == 3 and other.extra["copies"] == 0 and "duplicates" not in one.extra


def test_an_array_as_frame_function_is_cut_like_the_mesh():
    parts = Mesh(0.5 * BODY.V + [4, 0, 0], BODY.F), BODY
    mesh, own = beside(*parts), of_all((ends(parts[0]), 0), (ends(BODY), BODY.n))
    values = np.sin(3 * mesh.V[:, 0]) + mesh.V[:, 1]
    result = deformed(mesh, own, METHOD, vertices=150, frame_function=values)
    for k, shape in enumerate(parts):
        rows = slice(k * BODY.n, (k + 1) * BODY.n)
        task = DeformationTask("alone", shape, ends(shape))
        alone = METHOD(task, vertices=20 if k == 0 else 40, frame_function=values[rows])
        assert np.array_equal(result.vertices[rows], alone.vertices)
    with pytest.raises(InputError, match=f"needs {mesh.n} values"):
        deformed(mesh, own, METHOD, frame_function=values[1:])


def test_components_share_the_seconds_of_a_polish(monkeypatch):
    given = []

    def polished(task, options, **_):
        given.append(options.polish_seconds)
        return DeformationResult(task.mesh.V, 0, None, {"polish": 4.0})

    monkeypatch.setattr("sshade.pipeline.deform.polished", polished)
    result = deformed(PAIR, OF_PAIR, fine, polish_seconds=10.0)
    assert given == pytest.approx([5.0, 6.0]) and result.extra["options"]["polish_seconds"] == 10.0


@pytest.mark.parametrize("method", [METHOD, fast])
def test_a_guess_is_where_iterations_begin(method):
    task = DeformationTask("two", PAIR, OF_PAIR)
    guess, still = PAIR.V @ rotation(3).T, {"vertices": 150, "max_iterations": 0}
    for start, near in ((replace(task, guess=guess), True), (task, False)):
        apart = np.linalg.norm(method(start, **still).vertices - guess, axis=1)
        assert (np.median(apart) < 0.01 * PAIR.diagonal) == near

"""Sliding handles: minima against scipy.optimize, exact sets, limits, invariance, drags, files, mistakes."""

import json

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from baselines.arap import arap
from sshade import DeformationTask, Deformer, Handles, InputError, Mesh, Slide, deform
from sshade.io.handles import read_handles, write_handles
from sshade.solver.local_global import local_global
from tests.shapes import beside, block, icosphere, moved_parts, rotation, shifted
from tests.sshade.naive import Naive
from tests.sshade.pipeline.calls import fast, fine

EXACT = {"tolerance": 1e-11, "max_iterations": 20_000}
TURN = Rotation.from_euler("y", 40, degrees=True).as_matrix()
BAR = block(np.ones((1, 1, 3)), cells=1)
SPHERE, BALL = icosphere(4), icosphere(2)
TILTED = [0.3, -0.2, 1.0]


def ends(mesh: Mesh, slide, *, shift=(0.6, 0.3, 0.8), weight=np.inf, turned=False) -> DeformationTask:
    """The lower end stays, and the upper end slides through shifted targets."""
    z = mesh.V[:, 2]
    parts, turns = [(z < z.min() + 0.1, 0), (z > z.max() - 0.1, shift)], [None, TURN] if turned else None
    how = {"weights": [np.inf, weight], "slides": [None, slide], "rotations": turns}
    return DeformationTask("ends", mesh, moved_parts(mesh.V, *parts, **how))


def off(task: DeformationTask, V: np.ndarray) -> float:
    """Return the largest distance of a handle from its target or its slide, in diagonals."""
    return np.linalg.norm(V[task.handles.index] - task.handles.goals(V), axis=1).max() / task.mesh.diagonal


def minimum(
    task: DeformationTask, basis: np.ndarray, *, across=None, bounds=None
) -> tuple[float, np.ndarray]:
    """Minimise by L-BFGS-B, with moved handles at ``target + x @ basis``; return energy and positions."""
    naive, handles = Naive(task, "spokes_and_rims"), task.handles
    free = np.setdiff1d(np.arange(task.mesh.n), handles.index)
    moved, stiff = handles.group == 1, handles.weight * (1 if handles.portion is None else handles.portion)
    at, goal = handles.index[moved], handles.target[moved]

    def placed(x: np.ndarray) -> np.ndarray:
        P = task.mesh.V.copy()
        P[handles.index] = handles.target
        P[free] = x[: 3 * len(free)].reshape(-1, 3)
        P[at] = goal + x[3 * len(free) :].reshape(len(at), -1) @ basis
        return P

    def energy(x: np.ndarray) -> tuple[float, np.ndarray]:
        P, G = placed(x), np.zeros((task.mesh.n, 3))
        R = naive.rotations(P)
        if handles.prescribed_rotations:
            R[handles.prescribed_rotations[0]] = handles.prescribed_rotations[1]
        total = 0.0
        for cell in naive.cells.T:
            miss = P[naive.k] - P[naive.j] - np.einsum("iab,ib->ia", R[cell], naive.rest)
            total += (naive.h * (miss**2).sum(1)).sum()
            np.add.at(G, naive.k, 2 * naive.h[:, None] * miss)
            np.add.at(G, naive.j, -2 * naive.h[:, None] * miss)
        if across is not None:
            height = (P[at] - goal) @ across
            total += 3 * (stiff[moved] * height**2).sum()
            G[at] += 6 * (stiff[moved] * height)[:, None] * across
        return total, np.concatenate([G[free].ravel(), (G[at] @ basis.T).ravel()])

    start = np.concatenate([task.mesh.V[free].ravel(), np.zeros(len(at) * len(basis))])
    limits = None if bounds is None else [(None, None)] * (3 * len(free)) + bounds * len(at)
    how = {"maxiter": 20_000, "maxfun": 40_000, "ftol": 1e-15, "gtol": 1e-9, "maxcor": 40}
    found = minimize(energy, start, jac=True, method="L-BFGS-B", bounds=limits, options=how)
    return found.fun, placed(found.x)


NORMAL = np.array(TILTED) / np.linalg.norm(TILTED)
PLANE = np.linalg.svd(NORMAL[None])[2][1:]
MINIMA = {
    "plane": (Slide.plane(TILTED), {}, PLANE, {}),
    "line": (Slide.line(TILTED), {}, NORMAL[None], {}),
    "axes": (Slide.axes("xz"), {}, np.eye(3)[[0, 2]], {}),
    "turned": (Slide.plane(TILTED), {"turned": True}, PLANE, {}),
    "soft": (Slide.plane(TILTED), {"weight": 2.0}, np.eye(3), {"across": NORMAL}),
    "rotation": (Slide.anywhere(), {"turned": True}, np.eye(3), {}),
}


@pytest.mark.parametrize("kind", MINIMA)
def test_minima_are_those_of_another_minimiser(kind):
    slide, how, basis, penalty = MINIMA[kind]
    task = ends(BAR, slide, **how)
    result = local_global(task, **EXACT)
    energy, P = minimum(task, basis, **penalty)
    assert result.converged and energy > 0.01
    assert result.extra["energy"] == pytest.approx(energy, rel=1e-7)
    assert np.abs(result.vertices - P).max() < 1e-4
    assert kind == "soft" or off(task, result.vertices) < 1e-12


def test_a_surface_holds_handles_at_its_faces_and_at_its_edges():
    """A large triangle acts like its plane. A box acts on handles outside like bounds on coordinates."""
    handles, plane = ends(BAR, Slide.plane(TILTED)).handles, Slide.plane(TILTED)
    corners = handles.target[-1] + 20 * np.array([PLANE[0], PLANE[1], -PLANE[0] - PLANE[1]])
    flat = ends(BAR, Slide.on(Mesh(corners, np.array([[0, 1, 2]]))))
    # All vertices of the end slide on one plane.
    target = np.where(handles.group[:, None], handles.target[-1], handles.target)
    one = Handles(handles.index, target, slide=[plane if slide else None for slide in handles.slide])
    expected = local_global(DeformationTask("plane", BAR, one), **EXACT)
    result = local_global(flat, **EXACT)
    assert np.abs(result.vertices - expected.vertices).max() < 1e-7

    low = block(np.ones((1, 1, 1)))
    box = Mesh(2.0 * low.V - 3.0, low.F)  # from -1 to 1
    top = BALL.V[:, 2].argmax()
    # A target has no effect on a surface. Here it is the origin of the coordinates of `minimum`.
    parts = (BALL.V[:, 2] < -0.5, [-1.5, 0.2, 0.3]), ([top], np.zeros_like)
    task = DeformationTask("box", BALL, moved_parts(BALL.V, *parts, slides=[None, Slide.on(box)]))
    result = local_global(task, **EXACT)
    energy, P = minimum(task, np.eye(3), bounds=[(-1, 1)] * 3)
    assert P[top, 0] == -1 and P[top, 2] == 1  # on an edge
    assert result.extra["energy"] == pytest.approx(energy, rel=1e-6)
    assert np.abs(result.vertices - P).max() < 1e-3


def top_and_sides(slide, *, method=fast):
    """Push a ball at its side, and let all vertices near its top slide; return task and result."""
    x, _, z = SPHERE.V.T
    parts = (z < -0.9, 0), (x > 0.95, [0.5, 0.0, 0.4]), (z > 0.9, 0)
    task = DeformationTask("ball", SPHERE, moved_parts(SPHERE.V, *parts, slides=[None, None, slide]))
    return task, method(task, vertices=600)


@pytest.mark.parametrize("method", [fast, fine])
@pytest.mark.parametrize("slide", [Slide.plane([0, 0, 1]), Slide.line([1, 0, 1]), Slide.on(SPHERE)])
def test_regions_end_on_their_sets_exactly_and_move_along_them(slide, method):
    task, result = top_and_sides(slide, method=method)
    assert off(task, result.vertices) < 1e-12 and result.extra["hard_handle_error"] < 1e-12
    own = task.handles.index[task.handles.group == 2]
    assert np.linalg.norm(result.vertices[own] - SPHERE.V[own], axis=1).min() > 0.05
    # The push has a plane of symmetry.
    assert abs(result.vertices[own, 1].mean()) < 0.02


def test_the_scene_may_be_turned_and_a_stiff_spring_is_a_hard_slide():
    turn, task = rotation(3), ends(BAR, Slide.line(TILTED))
    hard = local_global(task, **EXACT)
    line = Slide.line(turn @ TILTED)
    kinds = [slide and line for slide in task.handles.slide]
    handles = Handles(task.handles.index, task.handles.target @ turn.T, slide=kinds)
    turned = local_global(DeformationTask("turned", Mesh(BAR.V @ turn.T, BAR.F), handles), **EXACT)
    assert np.abs(turned.vertices - hard.vertices @ turn.T).max() < 1e-8
    for weight, near in ((10.0, 0.2), (1e3, 2e-3), (1e6, 2e-6)):
        task = ends(BAR, Slide.line(TILTED), weight=weight)
        soft = local_global(task, **EXACT)
        assert soft.converged
        assert near / 50 < np.abs(soft.vertices - hard.vertices).max() < near


def test_motions_that_nothing_determines_stay_and_the_others_are_found():
    """Five handles on horizontal planes turn a ball. No handle determines a shift along the planes."""
    at = [SPHERE.V[:, c].argmax() for c in range(3)] + [SPHERE.V[:, 0].argmin(), SPHERE.V[:, 1].argmin()]
    R, normal = Rotation.from_euler("xy", [20, 10], degrees=True).as_matrix(), [0.0, 0.0, 1.0]
    sliding = Handles(np.array(at), SPHERE.V[at] @ R.T, slide=Slide.plane(normal))
    task = DeformationTask("ball", SPHERE, sliding)
    result = local_global(task, start="rigid", **EXACT)
    assert result.extra["energy"] < 1e-12 and off(task, result.vertices) < 1e-12
    assert np.abs(result.vertices[:, :2].mean(axis=0)).max() < 0.1


def test_a_drag_slides_and_settles_in_the_minimum():
    task, result = top_and_sides(Slide.plane([0, 0.2, 1]))
    handles, kinds = task.handles, list(task.handles.slide)
    binding = {"group": handles.group, "slide": kinds, "vertices": 600}
    drag = Deformer(task.mesh, handles.index, **binding)
    rest = task.mesh.V[handles.index]
    for part in (0.3, 0.6, 1.0):
        shape = drag(rest + part * (handles.target - rest), max_iterations=3).vertices
        at = handles.at(rest + part * (handles.target - rest))
        assert np.linalg.norm(shape[handles.index] - at.goals(shape), axis=1).max() < 1e-12
    settled = drag.settle().vertices
    assert off(task, settled) < 1e-12
    assert np.abs(settled - result.vertices).max() < 2e-3
    few = np.flatnonzero(np.isin(handles.index, drag.bindings[0].sampling.samples))
    drag.rebind_handles(handles.index[few], group=handles.group[few], slide=[kinds[k] for k in few])
    lifted = drag(handles.target[few] + [0, 0, 0.1]).vertices
    goals = Handles(handles.index[few], handles.target[few] + [0, 0, 0.1], slide=[kinds[k] for k in few])
    assert np.linalg.norm(lifted[goals.index] - goals.goals(lifted), axis=1).max() < 1e-9
    with pytest.raises(InputError, match="bound from the beginning"):
        drag.rebind_handles(handles.index, slide=Slide.on(SPHERE))


def test_components_slide_each_for_itself():
    two = beside(SPHERE, shifted(SPHERE, [4, 0, 0]))
    n, top, low = SPHERE.n, [SPHERE.V[:, 2].argmax()], np.flatnonzero(SPHERE.V[:, 2] < -0.9)
    parts = (low, [0.5, 0.1, 0]), (top, [0, 0, 0.2]), (low + n, [0, 0.6, 0.1]), ([top[0] + n], [0, 0, 0.2])
    own = moved_parts(two.V, *parts, slides=[None, Slide.plane([0, 0, 1])] * 2)
    task = DeformationTask("two", two, own)
    result = fast(task, vertices=1000)
    assert off(task, result.vertices) < 1e-12


FILE = {"kind": "dynamic", "vertices": [3], "target": [[0, 0, 1.5]]}


def read(path, *entries):
    path.write_text(json.dumps({"handles": list(entries)}))
    return read_handles(path, SPHERE)


def test_files_have_every_slide(here):
    (here / "store").mkdir()
    (here / "store/0123").write_text("v 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 3\n")
    for link, file in (("store/ground.obj", "0123"), ("deeper.json", "store/deeper.json")):
        (here / link).symlink_to(file)
    entries = [
        {"vertices": [0, 1], "kind": "static"},
        {"vertices": [2], "slide": {"plane": [0, 0, 2]}},
        {**FILE, "slide": {"line": [0, 1, 1]}, "weight": 3.0, "rotation": TURN.tolist()},
        {"source": [SPHERE.V[4].tolist()], "slide": {"axes": "xz"}},
        {"boxes": [[[0.95, -1, -1], [1, 1, 1]]], "slide": {"surface": "store/ground.obj"}},
        {"vertices": [6], "slide": {"surface": "rest"}},
        {"vertices": [7], "rotation": TURN.tolist(), "free": "position"},
    ]
    handles = read(here / "a.json", *entries)
    write_handles(here / "deeper.json", handles)
    again = read_handles(here / "deeper.json", SPHERE)
    assert len(read_handles(here / "store/deeper.json", SPHERE)) == len(again)
    P = 1.3 * SPHERE.V + [0.1, 0.2, 0.3]
    names = ("index", "target", "weight", "rotation", "group")
    assert all(np.array_equal(getattr(handles, n), getattr(again, n), equal_nan=True) for n in names)
    assert np.array_equal(handles.goals(P), again.goals(P)) and handles.slides.sum() == len(handles) - 2
    goals = handles.goals(P) - handles.target
    at = {number: np.flatnonzero(handles.group == number) for number in range(7)}
    assert np.abs([goals[at[1], 2], goals[at[3], 1]]).max() < 1e-14
    assert np.abs(goals[at[2], 1] - goals[at[2], 2]) < 1e-14 and np.abs(goals[at[2], 0]) < 1e-14
    assert (handles.goals(P)[at[4], 2] == 0).all()
    assert np.abs(np.linalg.norm(handles.goals(P)[at[5]], axis=1) - 1) < 0.01
    assert np.array_equal(handles.goals(P)[at[6]], P[[7]])


@pytest.mark.parametrize(
    "entry, words",
    [
        ({"slide": {"plane": [0, 0, 0]}}, "not all 0"),
        ({"slide": {"line": [1, float("nan"), 0]}}, "the direction"),
        ({"slide": {"plan": [0, 0, 1]}}, "did you mean"),
        ({"slide": {"plane": [0, 0, 1], "line": [0, 0, 1]}}, "takes one of"),
        ({"slide": {"axes": "w"}}, "one or two of x, y and z"),
        ({"slide": {"surface": "missing.ply"}}, "missing.ply: there is no such file"),
        ({"slide": {"surface": 3}}, 'path of a mesh file, or "rest", not 3'),
        ({"slide": {"surface": "empty.ply"}}, "the file is empty"),
        ({"slide": {"surface": "flat.obj"}}, "no face with an area"),
        ({"free": "position"}, 'needs a "rotation"'),
        ({"free": "position", "rotation": TURN.tolist()}, 'leave out "target"'),
        ({"rotation": (2 * TURN).tolist()}, "must have length 1 and be perpendicular"),
        ({"rotation": (-TURN).tolist()}, "it mirrors"),
        ({"rotation": [0, 0, 0, 2]}, "length 1, not 2"),
        ({"free": "rotation"}, '"position" only'),
    ],
)
def test_mistakes_in_files_are_one_sentence(here, entry, words):
    (here / "empty.ply").write_text("")
    (here / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    with pytest.raises(InputError, match=words):
        read(here / "a.json", {**FILE, **entry})


def test_mistakes_in_python_are_one_sentence():
    index, V, plane = np.array([0, 1]), SPHERE.V[[0, 1]], Slide.plane([0, 0, 1])
    with pytest.raises(InputError, match="a slide and a target"):
        Handles(np.array([0, 0]), V[[0, 0]], slide=[plane, None])
    with pytest.raises(InputError, match="free position has no weight"):
        Handles(index, V, weight=2.0, slide=Slide.anywhere())
    with pytest.raises(InputError, match="2 handles have 1 slides"):
        Handles(index, V, slide=[plane])
    with pytest.raises(InputError, match=r"a sshade\.Slide"):
        Handles(index, V, slide=[plane, "x"])
    with pytest.raises(InputError, match="give it a rotation"):
        deform(DeformationTask("free", SPHERE, Handles(index, V, slide=[None, Slide.anywhere()])))
    with pytest.raises(InputError, match="takes no sliding handles"):
        arap(DeformationTask("baseline", SPHERE, Handles(index, V, slide=[None, plane])))

"""Cases: what a mesh may look like. Some is refused by name, most has a promised result."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from sshade import Handles, Mesh
from sshade.io.handles import write_handles
from sshade.io.meshes import read_arrays, read_mesh, write_mesh
from tests.robustness.case import Case, run
from tests.robustness.inputs import BODY, Given, both, handles, mesh, pose, posed, write_sound
from tests.shapes import double_torus, jittered, strip, tetrahedron, torus, tube
from tests.sshade.mesh.test_cutting import moebius, t_fin

DEFORM = "sshade deform body.ply pose.json -o out.ply"
REPAIR = f"{DEFORM} --repair"
REMESH = "sshade remesh body.ply -o n.ply --map map.npz"
V, F = BODY.V, BODY.F


def _edited(change: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray] | None]) -> Given:
    """The body, changed; handles are those of the changed vertices."""
    W, G = V.copy(), F.copy()
    return posed(change(W, G) or (W, G))


def _at(place: object, value: object, *, of: str = "V") -> Given:
    """The body with an entry of V or F replaced; the pose stays the sound one."""
    W, G = V.copy(), F.copy()
    (W if of == "V" else G)[place] = value
    return mesh(W, G)


def _two() -> tuple[np.ndarray, np.ndarray]:
    """A second, smaller body beside the first."""
    return np.concatenate([V, 0.5 * V + [4, 0, 0]]), np.concatenate([F, F + len(V)])


def _handles_of_two() -> None:
    own = pose(V)
    further = Handles(own.index + len(V), 0.5 * own.target + [4, 0, 0], dynamic=own.dynamic)
    index, target = (
        np.concatenate([getattr(h, name) for h in (own, further)]) for name in ("index", "target")
    )
    write_handles("pose.json", Handles(index, target, dynamic=np.tile(own.dynamic, 2)))


def _touching() -> tuple[np.ndarray, np.ndarray]:
    """A second body that shares the topmost vertex with the first."""
    top, bottom = np.argmax(V[:, 2]), np.argmin(V[:, 2])
    W, G = np.concatenate([V, V + V[top] - V[bottom]]), np.concatenate([F, F + len(V)])
    G[len(V) + bottom == G] = top
    keep = np.arange(len(W)) != len(V) + bottom
    return W[keep], (np.cumsum(keep) - 1)[G]


# What must be refused, whatever else is done.
REFUSED = [
    Case("a NaN coordinate", DEFORM, _at((5, 1), np.nan), says=("vertex 5 has a NaN",)),
    Case("an infinite coordinate", DEFORM, _at((7, 0), np.inf), says=("vertex 7 has a NaN or infinite",)),
    Case("zero vertices", DEFORM, mesh(np.zeros((0, 3)), []), says=("0 vertices and 0 faces",)),
    Case("one vertex", DEFORM, mesh([[0, 0, 0]], []), says=("1 vertices and 0 faces",)),
    Case("two vertices", DEFORM, mesh(np.eye(3)[:2], [[0, 1, 0]]), says=("repeat a vertex", "--repair")),
    Case("vertices without faces", DEFORM, mesh(V, []), says=("162 vertices and 0 faces",)),
    Case(
        "a face out of range", DEFORM, _at((3, 2), 999, of="F"), says=("face 3", "the ids go from 0 to 161")
    ),
    Case("a face with a negative id", DEFORM, _at((3, 2), -1, of="F"), says=("face 3",)),
    Case(
        "a face out of range, with --repair",
        REPAIR,
        _at((3, 2), 999, of="F"),
        says=("no repair can mend that",),
    ),
    Case("a repeated index in a face", DEFORM, mesh(V, [*F, [4, 4, 7]]), says=("1 faces repeat", "--repair")),
    Case(
        "unreferenced vertices",
        DEFORM,
        mesh([*V, [9, 9, 9]], F),
        says=("1 vertices belong to no face", "--repair"),
    ),
    Case("a face twice, remesh", REMESH, mesh(V, [*F, F[0]]), says=("has 3 faces", "--repair")),
    Case(
        "one face turned, remesh", REMESH, _at(11, F[11, ::-1], of="F"), says=("not consistently oriented",)
    ),
    Case("a fin, remesh", REMESH, mesh(t_fin().V, t_fin().F), says=("not manifold: edge", "3 faces")),
    Case("two fans at a vertex, remesh", REMESH, mesh(*_touching()), says=("more than one fan",)),
    Case("two components, remesh", REMESH, mesh(*_two()), says=("2 components", "--repair")),
    Case(
        "a component without handles",
        DEFORM,
        mesh(*_two()),
        says=("1 of the mesh's 2 components", "--carry-loose"),
    ),
    Case("a soup without --repair", DEFORM, lambda: _soup(), says=("components have no handle", "--repair")),
    Case("all vertices in one place", DEFORM, mesh(np.ones_like(V), F), says=("coincide",)),
    Case("all vertices on a line", DEFORM, mesh(V * [0, 0, 1], F), says=("no area",)),
    Case("coordinates of 1e200", DEFORM, mesh(1e200 * V, F), says=("1e", "scale")),
    Case("coordinates of 1e-200", DEFORM, mesh(1e-200 * V, F), says=("scale",)),
    Case("far beyond the digits", DEFORM, mesh(V + 1e13, F), says=("digits",)),
    Case(
        "slivers of 1e-9 all along",
        DEFORM,
        posed(Mesh(strip(1, 300).V * [1e-9, 1, 1] @ np.eye(3)[[0, 2, 1]], strip(1, 300).F)),
        says=("nearly zero-area triangle",),
    ),
    Case(
        "a face out of range, remesh",
        REMESH,
        _at((3, 2), 999, of="F"),
        says=("face 3",),
    ),
]


def _result() -> np.ndarray:
    """The vertices that were written: finite, and the handles near their targets."""
    rest = read_arrays("body.ply")[0]
    moved, _ = read_arrays("out.ply")
    assert moved.shape == rest.shape and np.isfinite(moved).all()
    own = pose(rest)
    gap = np.linalg.norm(moved[own.index] - own.target, axis=1)
    diagonal = np.linalg.norm(np.ptp(rest, axis=0))
    assert gap.max() < 0.05 * diagonal, f"a handle is {gap.max() / diagonal:.2%} of the diagonal off"
    assert np.abs(moved - rest).max() < diagonal, "something flew away"
    return moved


def _equals(change: Callable[[np.ndarray], np.ndarray], tolerance: float) -> Callable[[], None]:
    """The result is the sound body's, changed."""

    def holds() -> None:
        found = _result()
        write_sound()
        assert run(DEFORM)[0] == 0
        expected = change(_result())
        gap = np.abs(found - expected).max() / np.linalg.norm(np.ptp(expected, axis=0))
        assert gap <= tolerance, f"{gap:.1e} of the diagonal from the sound body's result"

    return holds


def _taken(name: str, given: Given, holds: Callable[[], object] = _result, *, call: str = DEFORM) -> Case:
    return Case(
        name, call, given, leaves=("out.ply", "body.ply", "pose.json"), holds=lambda: (holds(), None)[1]
    )


def _far(offset: float) -> Given:
    """Coordinates of few bits, which a shift leaves as they are."""
    return posed((np.round(V * 2**20) / 2**20 + offset, F))


def _as_near_the_origin(offset: float, tolerance: float) -> None:
    far = _result() - offset
    _far(0.0)()
    assert run(DEFORM)[0] == 0
    gap = np.abs(far - _result()).max() / BODY.diagonal
    assert gap <= tolerance, f"{gap:.1e} of the diagonal from the result near the origin"


def _collapse(W: np.ndarray, G: np.ndarray) -> None:
    W[G[7, 0]] = W[G[7, 1]]


def _flatten(W: np.ndarray, G: np.ndarray) -> None:
    W[G[7, 0]] = 0.5 * (W[G[7, 1]] + W[G[7, 2]])


def _needle(W: np.ndarray, G: np.ndarray) -> None:
    W[G[7, 0]] = W[G[7, 1]] + 1e-9 * (W[G[7, 0]] - W[G[7, 1]])


def _soup() -> None:
    write_mesh("soup.stl", V, F)
    W, G = read_arrays("soup.stl")
    posed((W, G))()


def _turned(faces: Sequence[int]) -> Given:
    G = F.copy()
    G[list(faces)] = G[list(faces)][:, ::-1]
    return posed((V, G))


def _faces_stay() -> None:
    _result()
    assert np.array_equal(read_arrays("out.ply")[1], read_arrays("body.ply")[1])


TAKEN = [
    _taken("turned inside out", posed((V, F[:, ::-1])), _equals(lambda X: X, 1e-3)),
    _taken("scale 1e-6", posed((1e-6 * V, F)), _equals(lambda X: 1e-6 * X, 1e-9)),
    _taken("scale 1e6", posed((1e6 * V, F)), _equals(lambda X: 1e6 * X, 1e-9)),
    _taken("scale 2^-40", posed((2.0**-40 * V, F)), _equals(lambda X: 2.0**-40 * X, 0.0)),
    _taken("scale 1e-30", posed((1e-30 * V, F)), _equals(lambda X: 1e-30 * X, 1e-9)),
    _taken("scale 1e30", posed((1e30 * V, F)), _equals(lambda X: 1e30 * X, 1e-9)),
    _taken("2^20 from the origin", _far(2.0**20), lambda: _as_near_the_origin(2.0**20, 1e-9)),
    _taken("2^30 from the origin", _far(2.0**30), lambda: _as_near_the_origin(2.0**30, 2e-5)),
    _taken("a triangle of no area: two vertices in one place", _edited(_collapse)),
    _taken("a triangle of no area: three vertices on a line", _edited(_flatten)),
    _taken("a needle of 1e-9", _edited(_needle)),
    _taken("flattened to 1e-12", posed((V * [1e-12, 1, 1], F))),
    _taken("flattened to a double sheet", posed((V * [0, 1, 1], F))),
    _taken("stretched 10^4 times", posed((V * [1, 1, 1e4], F))),
    _taken("an open tube", posed(jittered(tube(), 0.02))),
    _taken("a strip with a rim", posed(Mesh(jittered(strip(30, 5), 0.1).V[:, [1, 2, 0]], strip(30, 5).F))),
    _taken(
        "a regular grid: every distance many times", posed(Mesh(strip(30, 5).V[:, [1, 2, 0]], strip(30, 5).F))
    ),
    _taken("genus 1", posed(Mesh(jittered(torus(), 0.02).V[:, [1, 2, 0]], torus().F))),
    _taken("genus 2", posed(Mesh(double_torus(cells=3).V[:, [1, 2, 0]], double_torus(cells=3).F))),
    _taken("a tetrahedron", posed(tetrahedron())),
    _taken("a face twice", posed((V, np.concatenate([F, F[:1]]))), _equals(lambda X: X, 1e-3)),
    _taken(
        "a face twice, once turned", posed((V, np.concatenate([F, F[:1, ::-1]]))), _equals(lambda X: X, 1e-3)
    ),
    _taken("one face turned", _turned([11]), _equals(lambda X: X, 0.0)),
    _taken("every third face turned", _turned(range(0, 320, 3)), _equals(lambda X: X, 0.0)),
    _taken("two components, each with handles", both(mesh(*_two()), _handles_of_two)),
    _taken(
        "a component without handles, with --carry-loose",
        mesh(*_two()),
        _faces_stay,
        call=f"{DEFORM} --carry-loose",
    ),
    _taken("two closed surfaces that touch in a vertex", posed(_touching())),
    _taken("a strip with a fin", posed((t_fin().V[:, [1, 2, 0]], t_fin().F))),
    _taken("a one-sided band", posed(moebius())),
    _taken(
        "one triangle",
        both(
            mesh(np.eye(3), [[0, 1, 2]]), handles({"vertices": [0, 1, 2], "target": (np.eye(3) + 1).tolist()})
        ),
        lambda: np.testing.assert_allclose(read_arrays("out.ply")[0], np.eye(3) + 1, atol=1e-12),
    ),
    _taken("a soup, with --repair", _soup, _faces_stay, call=REPAIR),
    _taken("a face twice, with --repair", posed((V, np.concatenate([F, F[:1]]))), _faces_stay, call=REPAIR),
    _taken(
        "duplicate vertices, with --repair",
        _edited(
            lambda W, G: (
                np.concatenate([W, W[:1]]),
                np.where((G == 0) & (np.arange(len(G)) % 2 == 0)[:, None], len(W), G),
            )
        ),
        _faces_stay,
        call=REPAIR,
    ),
]


def _million() -> Mesh:
    """A cube of 409 x 409 squares a side, blown up to a sphere: 1,003,688 vertices."""
    k = 409
    x, y = (a.ravel() for a in np.meshgrid(np.arange(k + 1), np.arange(k + 1), indexing="ij"))
    side = np.stack([x, y, np.zeros_like(x)], axis=1)
    a = (np.arange(k)[:, None] * (k + 1) + np.arange(k)).ravel()
    squares = np.stack([a, a + 1, a + k + 2, a + k + 1], axis=1)
    faces = np.concatenate([squares[:, [0, 1, 2]], squares[:, [0, 2, 3]]])
    points, triangles = [], []
    for axis in range(3):
        for far in (False, True):
            ids = np.roll(side + [0, 0, k * far], axis, axis=1)
            triangles.append((faces[:, ::-1] if far else faces) + len(side) * len(points))
            points.append(ids)
    key = np.concatenate(points) @ [(k + 1) ** 2, k + 1, 1]
    unique, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    W = np.concatenate(points)[first] - 0.5 * k
    W = W + np.random.default_rng(0).uniform(-0.2, 0.2, W.shape)
    return Mesh(W / np.linalg.norm(W, axis=1, keepdims=True), inverse[np.concatenate(triangles)])


def _write_million() -> None:
    shape = _million()
    assert shape.n == 1_003_688 and shape.is_manifold and shape.is_oriented and shape.topology.euler == 2
    write_mesh("body.ply", shape.V, shape.F)
    z = shape.V[:, 2]
    held, lifted = np.argsort(z)[:50], np.argsort(z)[-50:]
    handles(
        {"vertices": held.tolist()},
        {"vertices": lifted.tolist(), "target": (shape.V[lifted] + [0.2, 0, 0.1]).tolist()},
    )()


def _million_holds() -> None:
    moved, rest = read_mesh("out.ply"), read_mesh("body.ply")
    assert np.array_equal(moved.F, rest.F)
    lifted = np.argsort(rest.V[:, 2])[-50:]
    assert np.abs(moved.V[lifted] - rest.V[lifted] - [0.2, 0, 0.1]).max() < 0.01 * rest.diagonal


MILLION = Case(
    "a sphere of a million vertices",
    f"{DEFORM} --samplings 2",
    _write_million,
    leaves=("out.ply",),
    holds=_million_holds,
    slow=True,
)
CASES = [*REFUSED, *TAKEN, MILLION]

"""Cases: results that are promised exactly. :mod:`tests.sshade.files` has all other meshes."""

from collections.abc import Callable

import numpy as np

from sshade.files.meshes import read_arrays, read_mesh, write_mesh
from tests.robustness.case import Case, run
from tests.robustness.inputs import BODY, Given, handles, pose, posed, write_sound
from tests.shapes import torus

DEFORM = "sshade deform body.ply pose.json -o out.ply"
V, F = BODY.V, BODY.F


def _result() -> np.ndarray:
    """Return the written vertices; assert that they are finite and the handles are near their targets."""
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
    """Return a check that the result equals the sound body's result after `change`."""

    def holds() -> None:
        found = _result()
        write_sound()
        assert run(DEFORM)[0] == 0
        expected = change(_result())
        gap = np.abs(found - expected).max() / np.linalg.norm(np.ptp(expected, axis=0))
        assert gap <= tolerance, f"{gap:.1e} of the diagonal from the sound body's result"

    return holds


def _taken(name: str, given: Given, holds: Callable[[], object]) -> Case:
    return Case(name, DEFORM, given, leaves=("out.ply", "body.ply", "pose.json"), holds=holds)


TURNED = np.where(np.arange(len(F))[:, None] % 3, F, F[:, ::-1])
#: Each input that is accepted, and a check of its result. The handles must also be near their targets.
TAKEN = {
    "scale 1e-30": (posed((1e-30 * V, F)), _equals(lambda X: 1e-30 * X, 1e-9)),
    "scale 1e30": (posed((1e30 * V, F)), _equals(lambda X: 1e30 * X, 1e-9)),
    "a repeated index in a face": (posed((V, np.array([*F, [4, 4, 7]]))), _equals(lambda X: X, 0.0)),
    "every third face turned": (posed((V, TURNED)), _equals(lambda X: X, 0.0)),
}


def _write_million() -> None:
    shape = torus(1417, 709)
    assert shape.n > 1_000_000
    write_mesh("body.ply", shape.V, shape.F)
    order = np.argsort(shape.V[:, 0])
    target = shape.V[order[-50:]] + [0.2, 0, 0.1]
    moved = {"vertices": order[-50:].tolist(), "target": target.tolist()}
    handles({"vertices": order[:50].tolist()}, moved)()


def _million_holds() -> None:
    moved, rest = read_mesh("out.ply"), read_mesh("body.ply")
    assert np.array_equal(moved.F, rest.F)
    lifted = np.argsort(rest.V[:, 0])[-50:]
    assert np.abs(moved.V[lifted] - rest.V[lifted] - [0.2, 0, 0.1]).max() < 0.01 * rest.diagonal


MILLION = Case(
    "a torus of a million vertices",
    f"{DEFORM} --samplings 2",
    _write_million,
    leaves=("out.ply",),
    holds=_million_holds,
    slow=True,
)
CASES = [*(_taken(name, given, holds) for name, (given, holds) in TAKEN.items()), MILLION]

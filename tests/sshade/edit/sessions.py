"""Sessions without a browser, for tests."""

from pathlib import Path

import numpy as np

from sshade import Mesh
from sshade.edit.document import Document
from sshade.edit.groups import Motion
from sshade.edit.session import Session
from sshade.files.meshes import write_mesh
from tests.shapes import bumpy, torn

BODY = bumpy(3)
LOW, HIGH = (np.flatnonzero(keep) for keep in (BODY.V[:, 2] < -1.2, BODY.V[:, 2] > 1.2))
LIFT = Motion(np.eye(3), np.array([0.0, 0.0, 0.4]))


def upright(mesh: Mesh) -> Mesh:
    """Return the mesh with y upwards."""
    return Mesh(mesh.V[:, [1, 2, 0]], mesh.F)


def begun(mesh: Mesh = BODY, name: str = "body.ply", **given) -> Session:
    """Write a mesh and open it."""
    write_mesh(name, mesh.V, mesh.F)
    return edited(name, **given)


def edited(name: str = "body.ply", *, method: str = "fast", begin: str | None = None, **options) -> Session:
    """Open a file with the handle file `begin` and the options of :class:`Document`."""
    return Session(Document(Path(name), **options), method, begin and Path(begin))


def ends(V: np.ndarray, share: float = 0.15) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices at both ends of the longest extent."""
    x = V[:, np.argmax(np.ptp(V, axis=0))]
    low, high = x.min() + share * np.ptp(x), x.max() - share * np.ptp(x)
    return np.flatnonzero(x < low), np.flatnonzero(x > high)


def added(session: Session, vertices: np.ndarray, kind: str) -> int:
    """Make a group of some vertices; return its number."""
    session.select(vertices, "replace")
    return session.mark(kind)


def marked(session: Session) -> int:
    """Fix the lower end and make the upper end movable; return the number of the movable group."""
    held, free = ends(session.mesh.V)
    added(session, held, "fixed")
    return added(session, free, "moved")


def ready(mesh: Mesh = BODY, **given) -> tuple[Session, int]:
    """Return a session with a fixed and a movable end, and the number of the movable group."""
    session = begun(mesh, **given)
    return session, marked(session)


def settled(session: Session, number: int, motion: Motion) -> np.ndarray:
    """Release a group and return the converged shape."""
    session.release(number, motion)
    session.settle()
    return session.shown


def turned(V: np.ndarray, amount: float) -> Motion:
    """Return a rotation of the upper end about its middle and a shift, both larger for a larger amount."""
    _, free = ends(V)
    quaternion = np.array([0.1, 0.2, 0.3, 1 / max(amount, 1e-3)])
    return Motion.about(V[free].mean(axis=0), quaternion, amount * np.array([0.2, 0.3, -0.1]))


#: Groups by name: the direction from the middle of the body to the group, and the settings of the group.
SWITCHED = {
    "fixed": ([0, 0, -1], {"kind": "fixed"}),
    "turned": ([0, 0, 1], {}),
    "soft": ([0, 1, 0], {"weight": 4.0}),
    "fixed elsewhere": ([0, -1, 0], {"kind": "fixed"}),
    "stiff": ([1, 0, 0.2], {"weight": 30.0}),
}


def switched(*, single: bool) -> Session:
    """Return a session on a body and an unconstrained copy, with a group of every kind.

    The groups are caps, or single vertices if `single` is true.
    """
    V, F, _ = torn(BODY)
    V[BODY.n + 1 :] += 3e-7  # a seam that opened
    V, F = np.concatenate([V, BODY.V + [4, 0, 0]]), np.concatenate([F, len(V) + BODY.F])
    write_mesh("body.ply", V, F)
    session = edited(weld=1e-6, repair=True)
    assert session.mesh.n == 2 * BODY.n < len(V) - 1  # the first vertex is in no face
    unit = BODY.V / np.linalg.norm(BODY.V, axis=1)[:, None]
    for name, (direction, fields) in SWITCHED.items():
        near = unit @ (np.array(direction) / np.linalg.norm(direction))
        number = added(session, np.flatnonzero(near >= (near.max() if single else 0.95)), "moved")
        if name != "fixed":
            session.release(number, turned(BODY.V, 0.2 if name == "turned" else 0.05))
        session.alter(number, name=name, **fields)
    return session

"""How far a deformation distorts a mesh: a line that a user can judge a shape by.

The measures are cheap: stretch, flipped faces and volume are of the whole mesh, and intersections of the
proxies, if the mesh is large.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sshade.core.errors import counted
from sshade.core.kernels import kernel, subroutine
from sshade.mesh.crossings import crossing_faces
from sshade.mesh.mesh import Mesh

#: Largest number of faces of a mesh whose own intersections are counted.
WHOLE = 60_000
#: Least length of a side that counts for the stretch, as a fraction of the mean side. The lengths of shorter
#: sides mean little.
LEAST = 0.1
#: Relative change of the volume that is none.
KEPT = 5e-4


class Quality(NamedTuple):
    """Distortion of a shape, compared with the shape at rest.

    Attributes
    ----------
    stretch : float
        Largest ratio of the length of a side of a face to its length at rest.
    crossings : int or None
        Faces that intersect others and did not at rest; of the proxies, if the mesh is large. None if
        nothing counted them.
    flipped : int
        Faces that point against the faces around them and did not at rest.
    volume : float or None
        Relative change of the enclosed volume; None for a mesh that has none.
    """

    stretch: float
    crossings: int | None
    flipped: int
    volume: float | None

    def __str__(self) -> str:
        parts = [f"largest stretch {self.stretch:.2g}"]
        if self.crossings is not None:
            parts.append(_number(self.crossings, "new self-intersection"))
        words = ", ".join([*parts, _number(self.flipped, "flipped face")])
        if self.volume is None:
            return words
        change = f"{abs(100 * self.volume):.2g} % {'more' if self.volume > 0 else 'less'}"
        return f"{words}; {'volume kept' if abs(self.volume) < KEPT else f'{change} volume'}"


def worst(found: Sequence[Quality]) -> Quality:
    """Return the largest of each measure over several shapes."""
    stretch, crossings, flipped, volume = zip(*found, strict=True)
    known = [change for change in volume if change is not None]
    counts = [count for count in crossings if count is not None]
    return Quality(max(stretch), max(counts, default=None), max(flipped), max(known, key=abs, default=None))


def quality(mesh: Mesh, V: np.ndarray, proxies: Sequence[tuple[np.ndarray, np.ndarray]] = ()) -> Quality:
    """Measure a shape of a mesh.

    Parameters
    ----------
    mesh : Mesh
    V : (n, 3) float64
    proxies : sequence of ((k,) int, (l, 3) int)
        Vertices of the mesh, and faces between them, that stand for a large mesh.
    """
    stretch, flipped, before, after = _strained(mesh.V, V, mesh.F, LEAST)
    solid = mesh.is_closed and mesh.is_oriented and before
    crossings = None
    if mesh.m <= WHOLE or proxies:
        vertices, F = np.arange(mesh.n), mesh.F
        if mesh.m > WHOLE:
            vertices = np.concatenate([vertices for vertices, _ in proxies])
            first = np.cumsum([0, *(len(vertices) for vertices, _ in proxies)])
            F = np.concatenate([faces + k for (_, faces), k in zip(proxies, first, strict=False)])
        rest, shape = (crossing_faces(W[vertices], F) for W in (mesh.V, V))
        crossings = int((shape & ~rest).sum())
    return Quality(stretch, crossings, flipped, after / before - 1 if solid else None)


def _number(count: int, words: str) -> str:
    return counted(count, words, f"{words}s") if count else f"no {words}s"


@subroutine
def _length(V, a, b):
    return np.sqrt((V[a, 0] - V[b, 0]) ** 2 + (V[a, 1] - V[b, 1]) ** 2 + (V[a, 2] - V[b, 2]) ** 2)


@subroutine
def _normal(V, F, f):
    """The unit normal of a face, and the length of the normal that is twice its area."""
    a, b, c = F[f, 0], F[f, 1], F[f, 2]
    ux, uy, uz = V[b, 0] - V[a, 0], V[b, 1] - V[a, 1], V[b, 2] - V[a, 2]
    vx, vy, vz = V[c, 0] - V[a, 0], V[c, 1] - V[a, 1], V[c, 2] - V[a, 2]
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    size = np.sqrt(x * x + y * y + z * z)
    return (x / size, y / size, z / size, size) if size > 0.0 else (0.0, 0.0, 0.0, 0.0)


@subroutine
def _add_normals(V, F, around):
    """Add the unit normals of faces at their vertices (n, 3); return the enclosed volume."""
    volume, origin = 0.0, F[0, 0]
    for f in range(len(F)):
        x, y, z, size = _normal(V, F, f)
        a = F[f, 0]
        height = x * (V[a, 0] - V[origin, 0]) + y * (V[a, 1] - V[origin, 1]) + z * (V[a, 2] - V[origin, 2])
        volume += height * size / 6.0
        for v in F[f]:
            around[v, 0] += x
            around[v, 1] += y
            around[v, 2] += z
    return volume


@subroutine
def _against(V, F, f, around):
    """Whether a face points against the faces around it."""
    x, y, z, size = _normal(V, F, f)
    along = -3.0 if size > 0.0 else 0.0
    for v in F[f]:
        along += x * around[v, 0] + y * around[v, 1] + z * around[v, 2]
    return along < 0.0


@kernel
def _strained(V, U, F, least):
    """Return the largest stretch of a side, the number of flipped faces, and the volumes of V and U."""
    around, around_after = np.zeros((len(V), 3)), np.zeros((len(V), 3))
    volume, volume_after = _add_normals(V, F, around), _add_normals(U, F, around_after)
    total = 0.0
    for f in range(len(F)):
        for k in range(3):
            total += _length(V, F[f, k], F[f, (k + 1) % 3])
    shortest = least * total / (3 * len(F))
    stretch, flipped = 0.0, 0
    for f in range(len(F)):
        for k in range(3):
            a, b = F[f, k], F[f, (k + 1) % 3]
            length = _length(V, a, b)
            if length > shortest:
                stretch = max(stretch, _length(U, a, b) / length)
        flipped += _against(U, F, f, around_after) and not _against(V, F, f, around)
    return stretch, flipped, volume, volume_after

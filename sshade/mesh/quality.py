"""How far a deformation distorts a mesh: a line that a user can judge a shape by.

The measures are cheap: those of a large mesh are measured on its proxies, except for the volume.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sshade.core.errors import counted
from sshade.mesh.crossings import crossing_faces
from sshade.mesh.mesh import Mesh, unit_rows

#: Largest number of faces of a mesh that is measured itself.
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
    crossings : int
        Faces that intersect others and did not at rest.
    flipped : int
        Faces that point against the faces around them and did not at rest.
    volume : float or None
        Relative change of the enclosed volume; None for a mesh that has none.
    """

    stretch: float
    crossings: int
    flipped: int
    volume: float | None

    def __str__(self) -> str:
        found = {"new self-intersection": self.crossings, "flipped face": self.flipped}
        counts = [counted(n, name, f"{name}s") if n else f"no {name}s" for name, n in found.items()]
        words = ", ".join([f"largest stretch {self.stretch:.2g}", *counts])
        if self.volume is None:
            return words
        change = f"{abs(100 * self.volume):.2g} % {'more' if self.volume > 0 else 'less'}"
        return f"{words}; {'volume kept' if abs(self.volume) < KEPT else f'{change} volume'}"


def worst(found: Sequence[Quality]) -> Quality:
    """Return the largest of each measure over several shapes of a mesh."""
    stretch, crossings, flipped, volume = zip(*found, strict=True)
    return Quality(
        max(stretch), max(crossings), max(flipped), None if None in volume else max(volume, key=abs)
    )


def quality(
    mesh: Mesh,
    V: np.ndarray,
    proxies: Sequence[tuple[np.ndarray, np.ndarray]] = (),
    *,
    volume: float | None = None,
) -> Quality:
    """Measure a shape of a mesh.

    Parameters
    ----------
    mesh : Mesh
    V : (n, 3) float64
    proxies : sequence of ((k,) int, (l, 3) int)
        Vertices of the mesh, and faces between them, that stand for a large mesh.
    volume : float, optional
        Relative change of the volume.
    """
    vertices, F = np.arange(mesh.n), mesh.F
    if mesh.m > WHOLE and proxies:
        vertices = np.concatenate([vertices for vertices, _ in proxies])
        first = np.cumsum([0, *(len(vertices) for vertices, _ in proxies)])
        F = np.concatenate([faces + k for (_, faces), k in zip(proxies, first, strict=False)])
    rest, shape = mesh.V[vertices], V[vertices]
    before, after = (np.linalg.norm(W[F] - W[F[:, [1, 2, 0]]], axis=2) for W in (rest, shape))
    long = before > LEAST * before.mean()
    return Quality(
        float((after[long] / before[long]).max()),
        int((crossing_faces(shape, F) & ~crossing_faces(rest, F)).sum()),
        int((_against(shape, F) & ~_against(rest, F)).sum()),
        volume,
    )


def _against(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Return a mask (m,) of the faces that point against the faces around them."""
    a, b, c = V[F.T]
    normal = unit_rows(np.cross(b - a, c - a))
    sums = [np.bincount(F.ravel(), np.repeat(x, 3), len(V)) for x in normal.T]
    around = np.stack(sums, axis=1)[F].sum(axis=1) - 3 * normal
    return np.einsum("ij,ij->i", normal, around) < 0

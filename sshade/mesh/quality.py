"""How far a deformation distorts a mesh, in a line that a user can judge a shape by, and opens gaps in it.

The measures are cheap: those of a large mesh are measured on its proxies, except for the volume. A gap opens
between components that overlap or nearly touch at rest. Points about :data:`SPACING` apart stand for the
surface there, so that long triangles count like short ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sshade.core.errors import counted
from sshade.core.threads import available_cpus
from sshade.mesh.boxes import crossing_faces
from sshade.mesh.mesh import Mesh, unit_rows

#: Largest number of faces of a mesh that is measured itself.
MEASURED = 60_000
#: Least length of a side that counts for the stretch, as a fraction of the mean side. The lengths of shorter
#: sides mean little.
LEAST = 0.1
#: Relative change of the volume that is none.
KEPT = 5e-4
#: Largest distance of components that belong together, and least distance that is a gap, as fractions of the
#: bounding-box diagonal.
NEAR = 0.01
#: Distance between points of the surface, as a fraction of the diagonal.
SPACING = NEAR / 2
#: Number of nearest points among which those of other components are looked for.
BESIDE = 32
#: Steps of a sequence of pairs that covers the unit square evenly (M. Roberts, "R2", 2018).
STEPS = np.array([0.7548776662466927, 0.5698402909980532])


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
    if mesh.m > MEASURED and proxies:
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


class Gap(NamedTuple):
    """The largest distance that opened between two components.

    Attributes
    ----------
    distance : float
        As a fraction of the diagonal at rest.
    components : (int, int)
    pairs : int
        Number of pairs of components that came apart.
    """

    distance: float
    components: tuple[int, int]
    pairs: int


class NearParts:
    """The components of a mesh that overlap or nearly touch.

    Parameters
    ----------
    mesh : Mesh
    """

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._pairs = np.zeros((0, 2), dtype=np.int64)
        if mesh.topology.components == 1:
            return
        corners, weights = surface_points(mesh, SPACING * mesh.diagonal)
        component, P = mesh.component[corners[:, 0]], _at(mesh.V, corners, weights)
        cell = ((P - P.min(axis=0)) / (SPACING * mesh.diagonal)).astype(np.int64)
        key = np.ravel_multi_index((component, *cell.T), (component.max() + 1, *cell.max(axis=0) + 1))
        one = np.unique(key, return_index=True)[1]  # a point of each component in each cell is enough
        self._corners = corners[one]
        self._weights = weights[one]
        self._component = component[one]
        self._rest = P[one]
        reach, count = (NEAR + SPACING) * mesh.diagonal, len(one)
        near = cKDTree(self._rest).query(
            self._rest, BESIDE, distance_upper_bound=reach, workers=available_cpus()
        )[1]
        pairs = np.stack([np.repeat(np.arange(count), BESIDE), near.ravel()], axis=1)
        pairs = pairs[pairs[:, 1] < count]  # others are farther away
        #: Near points of two components.
        self._pairs = pairs[self._component[pairs[:, 0]] != self._component[pairs[:, 1]]]

    def gap(self, V: np.ndarray) -> Gap | None:
        """Return the largest gap that opened at positions V (n, 3), None if there is none.

        The gap between two points that were near is the distance of either from the other component, the
        lesser of both: parts that slide along each other have no gap. The distance at rest is no gap, nor are
        gaps in a shape that grew as a whole.
        """
        if not len(self._pairs):
            return None
        diagonal, P = self._mesh.diagonal, _at(V, self._corners, self._weights)
        growth = max(1.0, float(np.linalg.norm(np.ptp(V, axis=0))) / diagonal)
        least = NEAR * growth * diagonal
        i, j = self._pairs.T
        i, j = self._pairs[np.linalg.norm(P[i] - P[j], axis=1) > least].T  # others have a smaller gap
        count = int(self._component.max()) + 1
        # A point is in many pairs with the same component.
        once, which = np.unique(
            np.append(i, j) * count + self._component[np.append(j, i)], return_inverse=True
        )
        point, other = np.divmod(once, count)
        now, before = (self._distance(Q, point, other)[which] for Q in (P, self._rest))
        opened = np.minimum(*(now - growth * before).reshape(2, -1))
        wide = np.flatnonzero(opened > least)
        if not len(wide):
            return None
        pairs = np.sort(self._component[np.stack([i, j], axis=1)], axis=1)
        worst = wide[np.argmax(opened[wide])]
        one, two = pairs[worst].tolist()
        return Gap(float(opened[worst]) / diagonal, (one, two), len(np.unique(pairs[wide], axis=0)))

    def _distance(self, P: np.ndarray, point: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Return the distance of each point (k,) from another component (k,), at positions P (p, 3) of all.

        A fourth coordinate keeps the components apart in one tree.
        """
        apart = 2 * float(np.linalg.norm(np.ptp(P, axis=0)))
        tree = cKDTree(np.column_stack([P, apart * self._component]))
        return tree.query(np.column_stack([P[point], apart * other]), workers=available_cpus())[0]


def surface_points(mesh: Mesh, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Return points on a surface that are about `spacing` apart: vertices, and points on edges and faces.

    Returns
    -------
    corners : (p, 3) int64
        Three vertices of the component of each point.
    weights : (p, 3) float64
        The point is their sum with these weights.
    """
    edges, F = mesh.edges, mesh.F
    length = np.linalg.norm(mesh.V[edges[:, 0]] - mesh.V[edges[:, 1]], axis=1)
    on_edge, part = _repeated((length / spacing).astype(np.int64))
    in_face, number = _repeated((mesh.face_areas / spacing**2).astype(np.int64))
    u, v = (number[:, None] * STEPS % 1).T
    u, v = np.where(u + v > 1, (1 - u, 1 - v), (u, v))
    t = part * spacing / length[on_edge]
    corners = np.concatenate(
        [np.repeat(np.arange(mesh.n)[:, None], 3, axis=1), edges[on_edge][:, [0, 1, 1]], F[in_face]]
    )
    weights = [
        np.eye(3)[np.zeros(mesh.n, int)],
        np.stack([1 - t, t, 0 * t], axis=1),
        np.stack([1 - u - v, u, v], axis=1),
    ]
    return corners.astype(np.int64), np.concatenate(weights)


def _repeated(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return each place as often as its count says, and numbers from 1 for its repetitions."""
    place = np.repeat(np.arange(len(counts)), counts)
    return place, np.arange(len(place)) - np.repeat(np.cumsum(counts) - counts, counts) + 1


def _at(V: np.ndarray, corners: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return np.einsum("pk,pkc->pc", weights, V[corners])

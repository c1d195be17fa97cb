"""Distortion of faces: the symmetric Dirichlet energy, its tails, and faces that collapse.

The map of a face from M to M' is linear, with singular values s1 >= s2. Its
symmetric Dirichlet energy above that of a rigid motion,

    D = (s1^2 + s2^2 + 1 / s1^2 + 1 / s2^2) / 2 - 2,

is zero where the face keeps its shape and size, the same for a stretch by s as
for a shrinkage by 1 / s, and infinite where the face loses its area. Means of
length changes hide what few faces suffer; percentiles of D by area do not.

J. Smith, S. Schaefer, "Bijective parameterization with free boundaries", 2015.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from eval.metrics.geometry import weighted_percentile
from eval.metrics.registry import Task, metric
from sshade.contact.flips import new_flips
from sshade.mesh.mesh import Mesh

#: A face counts as collapsed where it is shrunk to less than this in some direction.
COLLAPSED = 0.1


def singular_values(rest: Mesh, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The singular values s1 >= s2 of the map of each face of M; NaN for rest faces without area.

    From the first fundamental form of M' in the basis of M's edges: the trace is
    ``s1^2 + s2^2``, the determinant ``(s1 s2)^2``, of which the smaller value is
    taken by division, as a difference would lose its digits.

    Parameters
    ----------
    rest : Mesh
        M.
    vertices : (n, 3) float64
        Positions of M'.

    Returns
    -------
    s1, s2 : (m,) float64
    """
    a, b, c, area = _first_form(rest.V, rest.F)
    A, B, C, deformed_area = _first_form(vertices, rest.F)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        trace = (c * A - 2 * b * B + a * C) / area**2
        product = deformed_area / area
        # (s1 + s2)^2 and (s1 - s2)^2: both sums of squares but for rounding.
        total = np.sqrt(np.maximum(trace + 2 * product, 0))
        difference = np.sqrt(np.maximum(trace - 2 * product, 0))
        s1 = 0.5 * (total + difference)
        s2 = np.where(s1 > 0, product / s1, 0.0)
    flat = area == 0
    s1[flat] = s2[flat] = np.nan
    return s1, s2


def dirichlet(rest: Mesh, vertices: np.ndarray) -> np.ndarray:
    """(m,) D of each face of M; NaN for rest faces without area, infinite for faces that lose it."""
    s1, s2 = singular_values(rest, vertices)
    with np.errstate(divide="ignore"):
        # (s - 1/s)^2 = s^2 + 1/s^2 - 2 cancels nothing near a rigid motion.
        return 0.5 * ((s1 - 1 / s1) ** 2 + (s2 - 1 / s2) ** 2)


@metric("-", "mean over area of D = (s1^2 + s2^2 + 1/s1^2 + 1/s2^2) / 2 - 2")
def distortion(task: Task, vertices: np.ndarray) -> float:
    """Area-weighted mean of D over the faces of M; NaN where a face has lost its area."""
    D, area = _known(task, vertices)
    return float((D * area).sum() / area.sum()) if len(D) else np.nan


@metric("-", "D that 95 % of the area does not exceed")
def distortion_95(task: Task, vertices: np.ndarray) -> float:
    """95th percentile by area of D; NaN where it is infinite."""
    return weighted_percentile(*_known(task, vertices), 95.0)


@metric("-", "D that 99 % of the area does not exceed")
def distortion_99(task: Task, vertices: np.ndarray) -> float:
    """99th percentile by area of D; NaN where it is infinite."""
    return weighted_percentile(*_known(task, vertices), 99.0)


@metric("-", "largest D of a face")
def distortion_max(task: Task, vertices: np.ndarray) -> float:
    """The largest D of a face; infinite where a face has lost its area."""
    D, _ = _known(task, vertices)
    return float(D.max()) if len(D) else np.nan


@metric("count", f"faces with s2 < {COLLAPSED}, or flipped")
def collapsed(task: Task, vertices: np.ndarray) -> float:
    """Faces of M that are shrunk to less than :data:`COLLAPSED` in some direction, or flipped."""
    _, s2 = singular_values(task.mesh, vertices)
    return float(((s2 < COLLAPSED) | new_flips(task.mesh, vertices)).sum())


def _known(task: Task, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """D and rest area of the faces that have an area at rest."""
    D, area = dirichlet(task.mesh, vertices), task.mesh.face_areas
    known = area > 0
    return D[known], area[known]


def _first_form(V: np.ndarray, F: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """E, F, G of the two edges at each face's first corner, and ``sqrt(EG - F^2)`` by their cross product."""
    u, v = V[F[:, 1]] - V[F[:, 0]], V[F[:, 2]] - V[F[:, 0]]
    dot = partial(np.einsum, "ij,ij->i")
    return dot(u, u), dot(u, v), dot(v, v), np.linalg.norm(np.cross(u, v), axis=1)

"""Distortion of faces: the symmetric Dirichlet energy, its tails, and faces that collapse.

The map of a face from M to M' is linear, with singular values s1 >= s2. The symmetric Dirichlet energy of the
map, minus the energy of a rigid motion, is

    D = (s1^2 + s2^2 + 1 / s1^2 + 1 / s2^2) / 2 - 2.

D is zero if the face keeps its shape and size, and infinite if the face loses its area. Stretch by s and
shrinkage by 1 / s have equal D. A mean over faces hides a few bad faces; percentiles of D by area show them.

J. Smith, S. Schaefer, "Bijective parameterization with free boundaries", 2015.
"""

from __future__ import annotations

import numpy as np

from eval.metrics.deformed import Deformed
from eval.metrics.registry import metric
from eval.metrics.shape import weighted_percentile

#: Smallest singular value of a face that does not count as collapsed.
COLLAPSED = 0.1


@metric("-", "mean over area of D = (s1^2 + s2^2 + 1/s1^2 + 1/s2^2) / 2 - 2")
def distortion(deformed: Deformed) -> float:
    """Return the area-weighted mean of D over the faces of M; infinite if a face has lost its area."""
    D, area = _with_area(deformed)
    return float((D * area).sum() / area.sum()) if len(D) else np.nan


@metric("-", "D that 95 % of the area does not exceed")
def distortion_95(deformed: Deformed) -> float:
    """Return the 95th percentile of D by area."""
    return weighted_percentile(*_with_area(deformed), 95.0)


@metric("-", "D that 99 % of the area does not exceed")
def distortion_99(deformed: Deformed) -> float:
    """Return the 99th percentile of D by area."""
    return weighted_percentile(*_with_area(deformed), 99.0)


@metric("-", "largest D of a face")
def distortion_max(deformed: Deformed) -> float:
    """Return the largest D of a face; infinite if a face has lost its area."""
    D, _ = _with_area(deformed)
    return float(D.max()) if len(D) else np.nan


@metric("count", f"faces with s2 < {COLLAPSED}, or flipped")
def collapsed(deformed: Deformed) -> float:
    """Count faces of M that are inverted, or shrunk to less than :data:`COLLAPSED` in some direction."""
    _, s2 = deformed.singular_values
    return float(((s2 < COLLAPSED) | deformed.flipped).sum())


def _with_area(deformed: Deformed) -> tuple[np.ndarray, np.ndarray]:
    """Return D and the rest area of all faces with an area at rest."""
    area = deformed.rest.face_areas
    has_area = area > 0
    return deformed.dirichlet[has_area], area[has_area]

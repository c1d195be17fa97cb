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

import numpy as np

from eval.metrics.deformed import Deformed
from eval.metrics.registry import metric
from eval.metrics.shape import weighted_percentile

#: A face counts as collapsed where it is shrunk to less than this in some direction.
COLLAPSED = 0.1


@metric("-", "mean over area of D = (s1^2 + s2^2 + 1/s1^2 + 1/s2^2) / 2 - 2")
def distortion(deformed: Deformed) -> float:
    """Area-weighted mean of D over the faces of M; NaN where a face has lost its area."""
    D, area = _known(deformed)
    return float((D * area).sum() / area.sum()) if len(D) else np.nan


@metric("-", "D that 95 % of the area does not exceed")
def distortion_95(deformed: Deformed) -> float:
    """95th percentile by area of D; NaN where it is infinite."""
    return weighted_percentile(*_known(deformed), 95.0)


@metric("-", "D that 99 % of the area does not exceed")
def distortion_99(deformed: Deformed) -> float:
    """99th percentile by area of D; NaN where it is infinite."""
    return weighted_percentile(*_known(deformed), 99.0)


@metric("-", "largest D of a face")
def distortion_max(deformed: Deformed) -> float:
    """The largest D of a face; infinite where a face has lost its area."""
    D, _ = _known(deformed)
    return float(D.max()) if len(D) else np.nan


@metric("count", f"faces with s2 < {COLLAPSED}, or flipped")
def collapsed(deformed: Deformed) -> float:
    """Faces of M that are shrunk to less than :data:`COLLAPSED` in some direction, or flipped."""
    _, s2 = deformed.singular_values
    return float(((s2 < COLLAPSED) | deformed.flipped).sum())


def _known(deformed: Deformed) -> tuple[np.ndarray, np.ndarray]:
    """D and rest area of the faces that have an area at rest."""
    area = deformed.rest.face_areas
    known = area > 0
    return deformed.dirichlet[known], area[known]

"""Similarities of handle groups, whole or partway."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sshade.core.errors import InputError
from sshade.mesh.rigid import rigidly_moved

#: Greatest difference of a matrix from the identity that counts as no rotation.
IDENTITY = 1e-12
#: Factors that convert positions between the coordinate systems LPS and RAS of medicine.
LPS_RAS = np.array([-1.0, -1.0, 1.0])


class Similarity(NamedTuple):
    """Motion of a group: points p move to ``s R (p - c) + c + t``.

    Attributes
    ----------
    rotation : (3, 3) float64
        R.
    translation : (3,) float64
        t.
    center : (3,) float64 or "centroid", optional
        c, or the mean of the places of the points, each place once. None stands for the origin.
    scale : float
        s, above 0.
    """

    rotation: np.ndarray
    translation: np.ndarray
    center: np.ndarray | str | None = None
    scale: float = 1.0

    @property
    def is_translation(self) -> bool:
        """Whether the motion neither turns nor scales."""
        return bool(np.abs(self.rotation - np.eye(3)).max() <= IDENTITY) and self.scale == 1

    def partway(self, amount: float) -> Similarity:
        """Return the motion with `amount` times the angle, the translation and the change of the scale.

        Raises
        ------
        InputError
            When the scale would be 0 or less.
        """
        if amount == 1:
            return self
        scale = 1 + amount * (self.scale - 1)
        if scale <= 0:
            raise InputError(
                f"the scale {self.scale:g} cannot be exceeded {amount:g} times; nothing would be left"
            )
        rotation = rotations_partway(self.rotation[None], amount)[0]
        return Similarity(rotation, amount * self.translation, self.center, scale)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Move points (k, 3)."""
        if self.center is None or self.is_translation:  # a translation is exact
            return rigidly_moved(points, self.scale * self.rotation, self.translation)
        center = np.unique(points, axis=0).mean(axis=0) if isinstance(self.center, str) else self.center
        return rigidly_moved(points - center, self.scale * self.rotation, center + self.translation)


def rotations_partway(R: np.ndarray, amount: float) -> np.ndarray:
    """Return rotations (k, 3, 3) with the same axes and `amount` times the angles."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(amount * Rotation.from_matrix(R).as_rotvec()).as_matrix()

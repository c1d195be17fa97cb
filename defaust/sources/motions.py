"""Bends, twists and lifts: how an end of a shape moves, and what lies between it and the end that is held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Bend:
    """Points below a height stay; above them the z axis is wound onto a circle, as long as it was.

    Parameters
    ----------
    low, high : float
        Heights at which the arc begins and ends; what lies above moves rigidly.
    degrees : float
        From +z towards +x.
    """

    low: float
    high: float
    degrees: float

    @property
    def radius(self) -> float:
        """Of the circle, whose centre is (radius, 0, low)."""
        return (self.high - self.low) / np.radians(self.degrees)

    def __call__(self, V: np.ndarray) -> np.ndarray:
        """(n, 3) places of points (n, 3)."""
        along = np.clip(V[:, 2], self.low, self.high)
        turn = (along - self.low) / self.radius
        across, beyond = V[:, 0] - self.radius, V[:, 2] - along
        x = self.radius + np.cos(turn) * across + np.sin(turn) * beyond
        z = self.low - np.sin(turn) * across + np.cos(turn) * beyond
        return np.column_stack([x, V[:, 1], z])

    @property
    def end(self) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (3, 3) and translation (3,) of the moved end."""
        cos, sin = np.cos(np.radians(self.degrees)), np.sin(np.radians(self.degrees))
        R = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
        return R, np.array([self.radius, 0.0, self.low]) - R @ [self.radius, 0.0, self.high]


@dataclass(frozen=True)
class Twist:
    """Points turn about the z axis, by an angle that grows linearly with their height.

    Parameters
    ----------
    low, high : float
        Heights at which the angle begins and ceases to grow.
    degrees : float
        Of what lies above, counter-clockwise seen from +z.
    """

    low: float
    high: float
    degrees: float

    def __call__(self, V: np.ndarray) -> np.ndarray:
        """(n, 3) places of points (n, 3)."""
        share = np.clip((V[:, 2] - self.low) / (self.high - self.low), 0.0, 1.0)
        cos, sin = np.cos(np.radians(self.degrees) * share), np.sin(np.radians(self.degrees) * share)
        x, y, z = V.T
        return np.column_stack([cos * x - sin * y, sin * x + cos * y, z])

    @property
    def end(self) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (3, 3) and translation (3,) of the moved end."""
        cos, sin = np.cos(np.radians(self.degrees)), np.sin(np.radians(self.degrees))
        return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3)


@dataclass(frozen=True)
class Lift:
    """A region rises along z; where the rest goes is left open."""

    height: float

    @property
    def end(self) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (3, 3) and translation (3,) of the moved region."""
        return np.eye(3), np.array([0.0, 0.0, self.height])

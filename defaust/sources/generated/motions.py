"""Bends, twists and lifts: the motion of one end of a shape, and the transition to its fixed end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class _Rotation:
    """Rotation that grows with the height z.

    Parameters
    ----------
    low, high : float
        Heights between which the angle grows from zero. Points below stay, points above move rigidly.
    degrees : float
        Angle above `high`.
    """

    low: float
    high: float
    degrees: float


class Bend(_Rotation):
    """Wind the z axis, from +z towards +x, onto a circular arc of the same length."""

    @property
    def radius(self) -> float:
        """Radius of the circle, whose centre is (radius, 0, low)."""
        return (self.high - self.low) / np.radians(self.degrees)

    def __call__(self, V: np.ndarray) -> np.ndarray:
        """Move points (n, 3)."""
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


class Twist(_Rotation):
    """Rotate about the z axis, counter-clockwise seen from +z, by an angle linear in the height."""

    def __call__(self, V: np.ndarray) -> np.ndarray:
        """Move points (n, 3)."""
        fraction = np.clip((V[:, 2] - self.low) / (self.high - self.low), 0.0, 1.0)
        cos, sin = np.cos(np.radians(self.degrees) * fraction), np.sin(np.radians(self.degrees) * fraction)
        x, y, z = V.T
        return np.column_stack([cos * x - sin * y, sin * x + cos * y, z])

    @property
    def end(self) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (3, 3) and translation (3,) of the moved end."""
        cos, sin = np.cos(np.radians(self.degrees)), np.sin(np.radians(self.degrees))
        return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3)


@dataclass(frozen=True)
class Lift:
    """Raise a region along z. The motion of the remaining surface is undefined."""

    height: float

    @property
    def end(self) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (3, 3) and translation (3,) of the moved region."""
        return np.eye(3), np.array([0.0, 0.0, self.height])

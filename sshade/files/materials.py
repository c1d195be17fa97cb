"""Materials and textures of a mesh file, as pictures of the mesh need them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Material(NamedTuple):
    """Colour of a surface.

    Attributes
    ----------
    colour : (3,) float64
        In sRGB from 0 to 1. It multiplies the texture.
    texture : callable, optional
        Return the bytes of an image file; raise OSError when the file cannot be read.
    """

    colour: np.ndarray
    texture: Callable[[], bytes] | None = None


class Skin(NamedTuple):
    """Texture coordinates and materials of all triangles.

    Attributes
    ----------
    uv : (t, 2) float64
        Texture coordinates; the second grows downwards, as in glTF.
    corners : (m, 3) int64
        Rows of `uv` for the corners of each triangle.
    material : (m,) int64
        Place of each triangle's material in `materials`.
    materials : list of Material
    """

    uv: np.ndarray
    corners: np.ndarray
    material: np.ndarray
    materials: list[Material]


def srgb(linear: np.ndarray) -> np.ndarray:
    """Convert linear colours from 0 to 1 to sRGB (IEC 61966-2-1)."""
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)

"""Cases: copies of vertices that differ a little; far, tiny and huge meshes; meshes of few vertices."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests import shapes
from tools.corpus.case import Case
from tools.corpus.plain import Random, Shapes, surface_cases
from tools.corpus.shapes import (
    Shape,
    body,
    circle,
    cubes,
    fan,
    lattice,
    noisy,
    of,
    plate,
    prism,
    sheet,
    shuffled,
    soup,
    split,
)


def _near(shape: Callable[[], Shape], size: float, *, whole: bool) -> Callable[[Random], Shape]:
    """Split vertices, move the copies by up to a fraction of the diagonal, and change all orders."""

    def make(random: Random) -> Shape:
        copies = soup(shape()) if whole else split(shape(), 0.4, random)
        return shuffled(noisy(copies, 0.45 * size, random), random)

    return make


def _stepped(shape: Callable[[], Shape], *, whole: bool) -> Callable[[Random], Shape]:
    """Split vertices, and move some coordinates of the copies to the next number of single precision."""

    def make(random: Random) -> Shape:
        V, F = soup(shape()) if whole else split(shape(), 0.4, random)
        V = V.astype(np.float32)
        there = np.where(random.random(V.shape) < 0.5, np.inf, -np.inf).astype(np.float32)
        V = np.where(random.random(V.shape) < 0.5, V, np.nextafter(V, there))
        return shuffled((V.astype(np.float64), F), random)

    return make


def _copies() -> list[Case]:
    found = []
    for suffix in (".ply", ".obj", ".off"):
        for size in (0.0, 1e-15, 1e-12, 1e-9):
            for whole in (False, True):
                label = f"{suffix[1:]} {'soup' if whole else 'split'} {size:g}"
                found += surface_cases("copies", {label: _near(lambda: body(2), size, whole=whole)}, suffix)
    for suffix in (".stl", ".glb", "f4.ply"):
        for whole in (True,) if suffix == ".stl" else (False, True):
            label = f"{suffix[-7:].strip('.')} {'soup' if whole else 'split'} of float32"
            found += surface_cases("copies", {label: _stepped(lambda: body(2), whole=whole)}, suffix)
    return found


def _turned_soup(random: Random) -> Shape:
    V, F = soup(body(2))
    return V, np.where(random.random((len(F), 1)) < 0.5, F, F[:, ::-1])


NOISY: Shapes = {
    "torus with noise": _near(lambda: of(shapes.torus()), 1e-9, whole=True),
    "open sheet with noise": _near(sheet, 1e-12, whole=True),
    "plate with noise": _near(lambda: plate(5), 1e-9, whole=False),
    "cubes with noise": _near(lambda: cubes((0, 0, 0), (2, 0, 0)), 1e-12, whole=True),
}
SOUPS: Shapes = {
    "soup of random orientation": _turned_soup,
    "body in STL": lambda r: shuffled(body(), r),
}


def _at(distance: float, scale: float = 1.0) -> Callable[[Random], Shape]:
    """A body some diagonals away from the origin."""

    def make(random: Random) -> Shape:
        V, F = body()
        away = distance * np.linalg.norm(np.ptp(V, axis=0)) * np.array([0.6, -0.64, 0.48])
        return scale * (V + away), F

    return make


FAR: Shapes = {f"{distance:g} diagonals": _at(distance) for distance in (1e3, 1e6)}
FAR_SINGLE: Shapes = {
    f"{distance:g} diagonals in single precision": _at(distance) for distance in (1e2, 1e3, 1e4)
}
SCALES: Shapes = {
    f"unit {scale:g}": _at(0.3, scale) for scale in (1e-20, 1e-12, 1e-6, 1e-3, 1e3, 1e6, 1e12, 1e30)
}
SCALES_SINGLE: Shapes = {f"unit {scale:g} in single precision": _at(0.3, scale) for scale in (1e-6, 1e6)}

TINY: Shapes = {
    "triangle": lambda r: (np.eye(3), np.array([[0, 1, 2]])),
    "two triangles": lambda r: lattice(2, 2, lambda u, v: [u, v, 0 * u]),
    "tetrahedron": lambda r: of(shapes.tetrahedron()),
    "pyramid": lambda r: prism_tip(circle(4)),
    "cube": lambda r: cubes((0, 0, 0), cells=1),
    "octahedron": lambda r: (np.vstack([np.eye(3), -np.eye(3)]), _octahedron()),
    "hexagon": lambda r: (np.append(np.c_[circle(6), np.zeros(6)], [[0, 0, 0]], axis=0), fan(6)),
    "icosahedron": lambda r: of(shapes.icosphere(0)),
    "triangular prism": lambda r: prism(circle(3), 2.0),
    "strip of ten": lambda r: of(shapes.strip(4, 1)),
    "smallest torus": lambda r: of(shapes.torus(3, 3)),
    "grid of twenty": lambda r: lattice(5, 4, lambda u, v: [2 * u, v, 0.2 * u * v]),
}


def prism_tip(outline: np.ndarray) -> Shape:
    """Return a pyramid over an outline (k, 2)."""
    k = len(outline)
    V = np.concatenate([np.c_[outline, np.zeros(k)], [[0, 0, 1.5]]])
    i = np.arange(1, k - 1)
    return V, np.concatenate([fan(k), np.stack([0 * i, i + 1, i], axis=1)])


def _octahedron() -> np.ndarray:
    faces = [(a, b, c) for a in (0, 3) for b in (1, 4) for c in (2, 5)]
    return np.array([(a, b, c) if (a + b + c) % 2 else (a, c, b) for a, b, c in faces])


CASES = [
    *_copies(),
    *surface_cases("copies", NOISY),
    *surface_cases("copies", SOUPS, ".stl"),
    *surface_cases("far", FAR),
    *surface_cases("far", FAR_SINGLE, "f4.ply"),
    *surface_cases("scale", SCALES),
    *surface_cases("scale", SCALES_SINGLE, ".stl"),
    *surface_cases("tiny", TINY),
]

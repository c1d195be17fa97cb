"""Make cases of surfaces, and write plain files of them."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

from tools.corpus import write
from tools.corpus.case import SEED, Case, one
from tools.corpus.shapes import Shape

Random = np.random.Generator
#: A shape of each name; a function of random numbers.
Shapes = dict[str, Callable[[Random], Shape]]


def seeded(name: str) -> Random:
    """Return the random numbers of a case."""
    return np.random.default_rng([SEED, zlib.crc32(name.encode())])


def content(shape: Shape, suffix: str) -> bytes:
    """Return a plain file of a shape; "f4.ply" stands for single precision."""
    V, F = shape
    if suffix == ".stl":
        return write.stl(V[F])
    if suffix == ".glb":
        gltf = write.Gltf()
        gltf.mesh(V, F)
        return gltf.glb()
    if suffix in (".obj", ".off"):
        return {".obj": write.obj, ".off": write.off}[suffix](V, F)
    return write.mesh_ply(V, F, kind="float" if suffix == "f4.ply" else "double")


def surface_cases(kind: str, table: Shapes, suffix: str = ".ply", **more: Any) -> list[Case]:
    found = []
    for label, shape in table.items():
        name = f"{kind}/{label}"
        file = f"mesh{suffix.removeprefix('f4')}"

        def make(name: str = name, shape: Callable[[Random], Shape] = shape) -> bytes:
            return content(shape(seeded(name)), suffix)

        found.append(one(name, file, make, **more))
    return found

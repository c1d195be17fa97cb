"""The shapes of a 3D view: reduced to fewer vertices and packed into text."""

from __future__ import annotations

import base64
import gzip
from typing import NamedTuple

import numpy as np

from sshade.mesh.mesh import Mesh
from sshade.sampling.proxy import sample_proxy

#: Largest mesh that is shown completely, and number of vertices of larger meshes. Ids fit into 16 bits.
LIMIT, SAMPLES = 28_000, 20_000


class Surface(NamedTuple):
    """The part of a mesh that the 3D view shows.

    Parameters
    ----------
    samples : (k,) int
        Vertices of the mesh.
    faces : (l, 3) int
        Faces, as indices into `samples`.
    cell : (n,) int
        Index into `samples` of the sample of each vertex of the mesh.
    """

    samples: np.ndarray
    faces: np.ndarray
    cell: np.ndarray

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the means (k,) of values (n,) over the cells of the samples."""
        return np.bincount(self.cell, values) / np.bincount(self.cell)


def surface(mesh: Mesh, *, keep: np.ndarray, limit: int = LIMIT, samples: int = SAMPLES) -> Surface:
    """Return the mesh, or above `limit` vertices a proxy of `samples` vertices that include `keep`.

    The vertices of the proxy are vertices of the mesh, and move with a deformation of the mesh.

    Raises
    ------
    InputError
        If a large mesh is not manifold or has several components.
    """
    if mesh.n <= limit:
        return Surface(np.arange(mesh.n), mesh.F, np.arange(mesh.n))
    coarse = sample_proxy(mesh, max(samples, len(keep)), first=keep)
    return Surface(coarse.samples, coarse.faces, coarse.cell)


def pack(shapes: list[np.ndarray], errors: list[np.ndarray | None], faces: np.ndarray, *, top: float) -> dict:
    """Pack shapes of one mesh as compressed base64.

    Little-endian: the faces as uint16; then for each shape its positions as uint16 in the bounding box of all
    shapes, coordinate by coordinate; and its error, if it has one, as uint8 of the range from 0 to `top`.

    Parameters
    ----------
    shapes : list of (k, 3) float64
    errors : list of (k,) float64 or None
    faces : (l, 3) int
    top : float

    Returns
    -------
    dict
        ``low`` and ``span`` of the box, and the ``data``.
    """
    points = np.concatenate(shapes)
    low = points.min(axis=0)
    span = np.maximum(points.max(axis=0) - low, np.finfo(np.float32).tiny)
    parts = [np.ascontiguousarray(faces, dtype="<u2").tobytes()]
    for V, error in zip(shapes, errors, strict=True):
        parts.append(np.rint((V - low) / span * 65535).astype("<u2").T.tobytes())
        if error is not None:
            parts.append(np.rint(255 * np.clip(error / top, 0, 1)).astype("u1").tobytes())
    packed = gzip.compress(b"".join(parts), compresslevel=9, mtime=0)
    return {"low": low.tolist(), "span": span.tolist(), "data": base64.b64encode(packed).decode("ascii")}

"""Local thickness: how far apart opposite points of a surface are, after a deformation and at rest.

A point of the surface and the first point that its inward normal hits at rest are a pair. The distance of a
pair at rest is the thickness there. The same two points of the surface are measured again in the deformed
shape, so that no ray can miss. The ratio of the two distances is below 1 where the shape is pinched. Two
walls that slide along each other raise the ratio; they do not lower it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from igl.embree import EmbreeIntersector

from sshade.mesh.mesh import Mesh

#: Number of pairs by default.
PAIRS = 500
#: Least distance of a hit, as a fraction of the diagonal. Nearer hits are the point itself.
NEAR = 1e-6
#: Largest cosine between the normals of a pair. Others are not opposite.
OPPOSITE = -0.5


class Pairs(NamedTuple):
    """Opposite points of a surface, each a point of a face.

    Attributes
    ----------
    face, opposite : (p,) int64
        Faces of the two points. The first point is the centroid of its face.
    weight : (p, 3) float64
        Barycentric coordinates of the second point.
    """

    face: np.ndarray
    opposite: np.ndarray
    weight: np.ndarray

    def lengths(self, V: np.ndarray, F: np.ndarray) -> np.ndarray:
        """Return (p,) distances of the pairs for positions V (n, 3) of the vertices of faces F (m, 3)."""
        other = np.einsum("pk,pkd->pd", self.weight, V[F[self.opposite]])
        return np.linalg.norm(V[F[self.face]].mean(axis=1) - other, axis=1)


def opposite_points(mesh: Mesh, *, pairs: int = PAIRS, faces: np.ndarray) -> Pairs:
    """Find opposite points of a mesh at rest, evenly distributed over its area.

    Parameters
    ----------
    mesh : Mesh
        Faces counter-clockwise seen from outside.
    pairs : int
        Number of first points. Points without an opposite point are left out.
    faces : (k,) int
        Faces of first points.
    """
    chance = mesh.face_areas[faces]
    rng = np.random.default_rng(0)
    face = np.sort(rng.choice(faces, min(pairs, len(faces)), replace=False, p=chance / chance.sum()))
    opposite, weight = _first_hits(mesh, face)
    cosine = np.einsum("pd,pd->p", mesh.face_normals[face], mesh.face_normals[opposite])
    found = (opposite >= 0) & (cosine <= OPPOSITE)
    return Pairs(face[found], opposite[found], weight[found])


def _first_hits(mesh: Mesh, face: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Face (p,) that each inward normal hits first, or -1, and barycentric coordinates (p, 3) there."""
    rays = EmbreeIntersector()
    rays.init(np.array(mesh.V), mesh.F.astype(np.int32))
    begin, along = mesh.V[mesh.F[face]].mean(axis=1), -mesh.face_normals[face]
    near = NEAR * mesh.diagonal
    hits = [rays.intersectRay_first(*ray, near) for ray in zip(begin, along, strict=True)]
    first, _, y, z = np.array(hits).T  # -1 where a ray hits nothing
    return first.astype(np.int64), np.stack([1 - y - z, y, z], axis=1)


def local_thickness(rest: Mesh, V: np.ndarray, pairs: Pairs) -> dict[str, float]:
    """Return the 5th percentile, median and 95th percentile of the ratio of thickness, deformed to rest.

    Parameters
    ----------
    rest : Mesh
    V : (n, 3) float64
        Deformed positions.
    pairs : Pairs
        See :func:`opposite_points`.
    """
    ratio = pairs.lengths(V, rest.F) / pairs.lengths(rest.V, rest.F)
    percents = {"p5": 5, "median": 50, "p95": 95}
    return {name: float(np.percentile(ratio, p)) if len(ratio) else np.nan for name, p in percents.items()}

"""How groups follow other groups, as mirror images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sshade.errors import InputError
from sshade.io.entries import REST
from sshade.mesh.mesh import Mesh
from sshade.mesh.seams import connected
from sshade.slides import Slide

#: Greatest portion of a group whose mirror image may lie in the group itself.
OVERLAP = 0.25


@dataclass(frozen=True, eq=False)
class Link:
    """How a group follows another group, its leader.

    Parameters
    ----------
    leader : int
        Number of the leader.
    axis : int
        The group makes the motion of the leader, mirrored across this coordinate in the middle of the mesh.
    slide : Slide, optional
        The slide of the leader whose mirror image the group has.
    """

    leader: int
    axis: int
    slide: Slide | None = None


def reflection(axis: int) -> np.ndarray:
    """Return the matrix (3, 3) that changes the sign of a coordinate."""
    return np.diag(np.where(np.arange(3) == axis, -1.0, 1.0))


def middle(mesh: Mesh) -> np.ndarray:
    """Return the centre (3,) of the bounding box, through which mirrors go."""
    return 0.5 * (mesh.V.min(axis=0) + mesh.V.max(axis=0))


def mirrored_vertices(mesh: Mesh, vertices: np.ndarray, axis: int, *, tree: Any) -> np.ndarray:
    """Return the vertices (j,) nearest to mirror images, at most the mean length of an edge away.

    Parameters
    ----------
    mesh : Mesh
    vertices : (k,) int64
    axis : int
    tree : scipy.spatial.cKDTree
        Search tree of the vertices of the mesh.
    """
    centre = middle(mesh)
    image = (mesh.V[vertices] - centre) @ reflection(axis) + centre
    distance, found = tree.query(image)
    return found[distance <= mesh.mean_edge]


def mirrored_slide(slide: Slide | None, axis: int, name: str) -> Slide | None:
    """Return the mirror image of a slide; raise InputError, which begins with `name`, if it has none."""
    if slide is None or "slide" not in slide.record:
        return slide
    ((kind, value),) = slide.record["slide"].items()
    if kind == "surface" and value != REST:
        raise InputError(f"{name} slides on a surface, which has no mirrored surface")
    if kind in ("plane", "line"):
        return (Slide.plane if kind == "plane" else Slide.line)(reflection(axis) @ value)
    return slide


def sides(mesh: Mesh, vertices: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Divide vertices (k,) into connected pieces above, below and across the middle of the mesh."""
    place = np.full(mesh.n, -1)
    place[vertices] = np.arange(len(vertices))
    i, j = place[mesh.edges].T
    inside = (i >= 0) & (j >= 0)
    _, piece = np.unique(connected(len(vertices), i[inside], j[inside]), return_inverse=True)
    above = mesh.V[vertices, axis] > middle(mesh)[axis]
    portion = np.bincount(piece, above) / np.bincount(piece)
    return vertices[portion[piece] == 1], vertices[portion[piece] == 0], vertices[portion[piece] % 1 > 0]

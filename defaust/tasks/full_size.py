"""Target poses of a rest mesh of any resolution, in vertex correspondence with it.

A dataset stores its poses at the resolution of the registered meshes. For a
finer rest mesh they are computed when a task is loaded, in a second or two. The
registered mesh is subdivided as it was before the remeshing, so that each vertex
of the rest mesh lies on a triangle of the subdivided one. Bodies of the package
are skinned: the weights, subdivided with the mesh, are interpolated there.
For other meshes the registered pose is subdivided too, and interpolated.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from defaust.build.upsample import subdivide
from defaust.sources.skinning import apply_motions
from defaust.sources.synthetic import SHA256, load_bodies
from defaust.tasks.loop import loop_matrix
from sshade import InputError, Mesh

#: A remeshed surface lies so near to the one that it was made from (x diagonal).
ON_SURFACE = 1e-6


class Registered(NamedTuple):
    """What a dataset stores of a subject in a pose.

    Attributes
    ----------
    rest : Mesh
        Rest mesh at the resolution of the task; `low` itself at low resolution.
    low, posed : Mesh
        Registered rest mesh and target pose.
    steps : int
        Subdivisions between `low` and `rest`.
    """

    rest: Mesh
    low: Mesh
    posed: Mesh
    steps: int


def true_pose(meshes: Registered, skin: Skin | None) -> tuple[np.ndarray, str]:
    """Where the vertices of the rest mesh are in the pose.

    Returns
    -------
    (n, 3) float64
    str
        ``registration``, ``skinning`` or ``subdivision``: what it was made by.

    Raises
    ------
    InputError
        As :func:`subdivided_pose`.
    """
    rest, low, posed, steps = meshes
    if rest is low:
        return posed.V, "registration"
    if skin is not None:
        return skin(rest.V), "skinning"
    return subdivided_pose(rest, low, posed, steps=steps), "subdivision"


def find_skin(meshes: Registered, source: Mapping[str, Any], *, subject: int, pose: str) -> Skin | None:
    """The skinning of a subject, where a dataset's record of its source says that there is one.

    Raises
    ------
    InputError
        As :func:`has_skin` and :class:`Skin`.
    """
    if not has_skin(source):
        return None
    return Skin(meshes.rest, meshes.low, steps=meshes.steps, subject=subject, pose=pose)


def has_skin(source: Mapping[str, Any]) -> bool:
    """Whether a dataset's record of its source says that it can be skinned.

    Raises
    ------
    InputError
        When its bodies are those of another version of the package.
    """
    asset = source.get("asset_sha256")
    if asset not in (None, SHA256):
        raise InputError(
            f"the dataset was made from other bodies (asset {asset[:12]}) than those of this version "
            f"({SHA256[:12]}); build it again"
        )
    return asset is not None


class Skin:
    """The dual quaternion skinning of a synthetic body into a pose, at the vertices of a mesh of it.

    Parameters
    ----------
    rest : Mesh
        The points' mesh: the registered rest mesh, or the one remeshed from it.
    low : Mesh
        The registered rest mesh.
    steps : int
        Subdivisions between the two. The weights are subdivided too, by Loop's
        rules: interpolated linearly over the registered triangles they would have
        creases along the edges, and so would the posed surface.
    subject : int
    pose : str
        Name of the pose.

    Raises
    ------
    InputError
        When the package has no such body or pose, and as :func:`subdivided_pose`.
    """

    def __init__(self, rest: Mesh, low: Mesh, *, steps: int, subject: int, pose: str) -> None:
        bodies = load_bodies()
        known = 0 <= subject < len(bodies.rest) and pose in bodies.pose_names
        if not known or not np.array_equal(low.F, bodies.faces):
            raise InputError(f"the package has no body {subject} with these faces in the pose {pose!r}")
        k = bodies.pose_names.index(pose)
        motions = bodies.motions(subject, rotations=bodies.rotations[subject, k])
        if rest is not low:
            # Blending is linear: subdivided and interpolated motions are those of such weights.
            fine, interpolate = _on_subdivided(rest, low, steps=steps)
            motions = interpolate @ (loop_matrix(low, fine, steps=steps) @ motions)
        self._motions = motions
        self._shift = bodies.shifts[subject, k]

    def __call__(self, V: np.ndarray) -> np.ndarray:
        """(n, 3) posed positions of the mesh's vertices, which may have been moved by an edit."""
        return apply_motions(self._motions, V) + self._shift


def subdivided_pose(rest: Mesh, low: Mesh, posed: Mesh, *, steps: int) -> np.ndarray:
    """Interpolate a registered pose, subdivided, at the vertices of a finer rest mesh.

    Parameters
    ----------
    rest : Mesh
        Remeshed from the registered rest mesh after `steps` subdivisions.
    low, posed : Mesh
        The registered rest mesh and pose, in correspondence.
    steps : int

    Returns
    -------
    (n, 3) float64

    Raises
    ------
    InputError
        When the subdivisions do not correspond, or `rest` does not lie on the
        subdivided rest mesh.
    """
    fine, interpolate = _on_subdivided(rest, low, steps=steps)
    fine_posed = subdivide(posed, steps=steps)
    if not np.array_equal(fine.F, fine_posed.F):
        raise InputError("the pose is subdivided into other triangles than the rest mesh")
    return interpolate @ fine_posed.V


def _on_subdivided(rest: Mesh, low: Mesh, *, steps: int) -> tuple[Mesh, csr_array]:
    """The subdivided registered mesh, and the interpolation from it to a mesh that lies on it."""
    fine = subdivide(low, steps=steps)
    interpolate, distance = interpolation(rest.V, fine.V, fine.F)
    if distance.max() > ON_SURFACE * low.diagonal:
        raise InputError(
            f"the rest mesh lies up to {distance.max() / low.diagonal:.1g} x its diagonal off the subdivided "
            "registered mesh that it should have been made from; build the dataset again"
        )
    return fine, interpolate


def interpolation(points: np.ndarray, V: np.ndarray, F: np.ndarray) -> tuple[csr_array, np.ndarray]:
    """Barycentric interpolation of values at a mesh's vertices to the surface points nearest to others.

    Parameters
    ----------
    points : (k, 3) float64
    V : (n, 3) float64
    F : (m, 3) int64

    Returns
    -------
    (k, n) sparse float64
        Three entries a row, none negative, which add up to 1.
    (k,) float64
        Distances to the surface.
    """
    import igl

    squared, face, nearest = igl.point_mesh_squared_distance(points, V, F)
    corners = F[face]
    a, b, c = (np.ascontiguousarray(V[corners[:, k]]) for k in range(3))
    weights = np.maximum(0.0, igl.barycentric_coordinates(nearest, a, b, c))
    weights /= weights.sum(axis=1, keepdims=True)
    rows = 3 * np.arange(len(points) + 1)
    return csr_array((weights.ravel(), corners.ravel(), rows), shape=(len(points), len(V))), np.sqrt(squared)

"""Ground truth at high resolution: target poses of a remeshed rest mesh, in vertex correspondence with it.

A dataset stores target poses at the resolution of the registered meshes only. For a finer rest mesh they are
computed when a task is loaded. The registered mesh is subdivided as in the build, so every vertex of the rest
mesh lies on a triangle of the subdivided mesh. Synthetic bodies are skinned: the skinning weights are
subdivided and interpolated on that triangle. For other meshes the subdivided registered pose is interpolated.
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

#: Maximum distance of a remeshed surface from the subdivided one, as a fraction of the diagonal.
ON_SURFACE = 1e-6


class Registered(NamedTuple):
    """The stored meshes of a subject in a pose.

    Attributes
    ----------
    rest : Mesh
        Rest mesh at the resolution of the task; the same object as `low` at low resolution.
    low, posed : Mesh
        Registered rest mesh and target pose.
    steps : int
        Number of subdivisions between `low` and `rest`.
    """

    rest: Mesh
    low: Mesh
    posed: Mesh
    steps: int


def true_pose(meshes: Registered, skin: Skin | None) -> tuple[np.ndarray, str]:
    """Compute the positions of the rest mesh's vertices in the pose.

    Returns
    -------
    (n, 3) float64
    str
        Origin of the positions: ``registration``, ``skinning`` or ``subdivision``.

    Raises
    ------
    InputError
        See :func:`subdivided_pose`.
    """
    rest, low, posed, steps = meshes
    if rest is low:
        return posed.V, "registration"
    if skin is not None:
        return skin(rest.V), "skinning"
    return subdivided_pose(rest, low, posed, steps=steps), "subdivision"


def find_skin(meshes: Registered, source: Mapping[str, Any], *, subject: int, pose: str) -> Skin | None:
    """Skinning of a subject; None if the dataset's source has none.

    Raises
    ------
    InputError
        When the dataset was built from the bodies of another version of the package; and see :class:`Skin`.
    """
    asset = source.get("asset_sha256")
    if asset is None:
        return None
    if asset != SHA256:
        raise InputError(
            f"the dataset was made from other bodies (asset {asset[:12]}) than the bodies of this version "
            f"({SHA256[:12]}); build it again"
        )
    return Skin(meshes.rest, meshes.low, steps=meshes.steps, subject=subject, pose=pose)


class Skin:
    """Dual quaternion skinning of a synthetic body into a pose, at the vertices of a mesh of the body.

    Parameters
    ----------
    rest : Mesh
        The mesh to be skinned: the registered rest mesh, or a mesh remeshed from it.
    low : Mesh
        The registered rest mesh.
    steps : int
        Number of subdivisions between the two. The weights are subdivided by Loop's rules. Linear
        interpolation on the registered triangles would crease weights and posed surface along edges.
    subject : int
    pose : str
        Name of the pose.

    Raises
    ------
    InputError
        When the package has no such body or pose; and see :func:`subdivided_pose`.
    """

    def __init__(self, rest: Mesh, low: Mesh, *, steps: int, subject: int, pose: str) -> None:
        bodies = load_bodies()
        known = 0 <= subject < len(bodies.rest) and pose in bodies.pose_names
        if not known or not np.array_equal(low.F, bodies.faces):
            raise InputError(f"the package has no body {subject} with these faces in the pose {pose!r}")
        k = bodies.pose_names.index(pose)
        motions = bodies.motions(subject, rotations=bodies.rotations[subject, k])
        if rest is not low:
            # Blending is linear, so subdividing the motions is the same as subdividing the weights.
            fine, interpolate = _on_subdivided(rest, low, steps=steps)
            motions = interpolate @ (loop_matrix(low, fine, steps=steps) @ motions)
        self._motions = motions
        self._shift = bodies.shifts[subject, k]

    def __call__(self, V: np.ndarray) -> np.ndarray:
        """Pose vertex positions (n, 3), which an edit may have moved."""
        return apply_motions(self._motions, V) + self._shift


def subdivided_pose(rest: Mesh, low: Mesh, posed: Mesh, *, steps: int) -> np.ndarray:
    """Subdivide a registered pose and interpolate it at the vertices of a finer rest mesh.

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
        When the subdivisions do not correspond, or `rest` does not lie on the subdivided rest mesh.
    """
    fine, interpolate = _on_subdivided(rest, low, steps=steps)
    fine_posed = subdivide(posed, steps=steps)
    if not np.array_equal(fine.F, fine_posed.F):
        raise InputError(
            "the pose is subdivided into other triangles than the rest mesh; build the dataset again"
        )
    return interpolate @ fine_posed.V


def _on_subdivided(rest: Mesh, low: Mesh, *, steps: int) -> tuple[Mesh, csr_array]:
    """Subdivide the registered mesh; return it with the interpolation at the vertices of `rest`."""
    fine = subdivide(low, steps=steps)
    interpolate, distance = interpolation(rest.V, fine.V, fine.F)
    if distance.max() > ON_SURFACE * low.diagonal:
        raise InputError(
            f"the rest mesh was not made from the subdivided registered mesh: it is up to "
            f"{distance.max() / low.diagonal:.1g} x the diagonal away; build the dataset again"
        )
    return fine, interpolate


def interpolation(points: np.ndarray, V: np.ndarray, F: np.ndarray) -> tuple[csr_array, np.ndarray]:
    """Barycentric interpolation of vertex values at the surface points nearest to given points.

    Parameters
    ----------
    points : (k, 3) float64
    V : (n, 3) float64
    F : (m, 3) int64

    Returns
    -------
    (k, n) sparse float64
        Each row has three nonnegative entries that add up to 1.
    (k,) float64
        Distances of the points to the surface.
    """
    import igl

    squared, face, nearest = igl.point_mesh_squared_distance(points, V, F)
    corners = F[face]
    a, b, c = (np.ascontiguousarray(V[corners[:, k]]) for k in range(3))
    weights = np.maximum(0.0, igl.barycentric_coordinates(nearest, a, b, c))
    weights /= weights.sum(axis=1, keepdims=True)
    rows = 3 * np.arange(len(points) + 1)
    return csr_array((weights.ravel(), corners.ravel(), rows), shape=(len(points), len(V))), np.sqrt(squared)

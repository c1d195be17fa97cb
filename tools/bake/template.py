"""Make the closed template mesh, and interpolate values where it closes holes of the base mesh."""

from __future__ import annotations

import igl
import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import splu

from defaust.build.upsample import self_intersecting
from defaust.sources.synthetic import QUANTUM
from sshade import InputError, Mesh

#: Number of FAUST's faces; the template then has FAUST's 6890 vertices.
FACES = 13776


def outer_skin(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Mark the faces that are skin, not part of the mouth or an eye socket.

    Mouth and eye sockets are closed pockets in the head, which are hidden from outside and intersect
    themselves in every shape.

    Parameters
    ----------
    V : (n, 3) float64
    F : (m, 3) int64

    Returns
    -------
    (m,) bool
    """
    centre = V[F].mean(axis=1)
    normal = igl.per_face_normals(V, F, np.zeros(3))
    hidden = igl.ambient_occlusion(V, F, centre, normal, 64) > 0.93
    hidden &= centre[:, 1] > V[:, 1].min() + 0.8 * np.ptp(V[:, 1])
    ids = np.flatnonzero(hidden)
    component = igl.facet_components(F[ids])[1]
    size = np.bincount(component)
    pockets = np.zeros(len(F), dtype=bool)
    pockets[ids[size[component] >= 40]] = True
    # Add two rings of faces, because the rims of lips and lids still intersect themselves.
    for _ in range(2):
        touched = np.zeros(len(V), dtype=bool)
        touched[F[pockets]] = True
        pockets |= touched[F].any(axis=1)
    return ~pockets


def make_template(V: np.ndarray, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Close the holes, decimate to :data:`FACES`, and even out the triangles.

    Quadric decimation keeps the fingers. Uniform remeshing to this count would lose them, because its edges
    are 17 mm long.
    """
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(V, F))
    meshes.meshing_remove_unreferenced_vertices()
    meshes.meshing_close_holes(maxholesize=10_000, refinehole=True)
    meshes.set_selection_none()
    closed = pymeshlab.Mesh(meshes.current_mesh().vertex_matrix(), meshes.current_mesh().face_matrix())
    surface = (closed.vertex_matrix().copy(), closed.face_matrix().astype(np.int64))
    meshes.meshing_decimation_quadric_edge_collapse(
        targetfacenum=FACES,
        preservetopology=True,
        preservenormal=True,
        qualitythr=0.6,
        planarquadric=True,
        selected=False,
    )
    T = meshes.current_mesh().vertex_matrix().copy()
    TF = meshes.current_mesh().face_matrix().astype(np.int64)
    for _ in range(6):
        T = _relax(T, TF, step=0.35)
        T = igl.point_mesh_squared_distance(T, *surface)[2]
    return T, TF


def fill(values: np.ndarray, known: np.ndarray, *, T: np.ndarray, TF: np.ndarray) -> np.ndarray:
    """Replace the values (n, ...) of vertices that are not `known` by harmonic values (cotan Laplacian)."""
    flat = values.reshape(len(values), -1).copy()
    L = -igl.cotmatrix(T, TF).tocsc()
    free = np.flatnonzero(~known)
    fixed = np.flatnonzero(known)
    flat[free] = splu(L[free][:, free]).solve(-(L[free][:, fixed] @ flat[fixed]))
    return flat.reshape(values.shape)


def smooth_weights(W: np.ndarray, TF: np.ndarray, *, steps: int = 6) -> np.ndarray:
    """Smooth weights by half steps of the uniform Laplacian. Unsmoothed, creases stretch edges 17-fold."""
    average = neighbour_average(TF)
    for _ in range(steps):
        W = 0.5 * (W + average @ W)
    return W


def quantise_weights(W: np.ndarray, *, keep: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Keep the largest weights of each vertex, as bytes that add up to 255.

    Returns
    -------
    bone, weight : (n, keep) uint8
    """
    bone = np.argsort(-W, axis=1, kind="stable")[:, :keep]
    top = np.take_along_axis(W, bone, axis=1)
    exact = 255.0 * top / top.sum(axis=1, keepdims=True)
    weight = np.floor(exact).astype(np.int64)
    # Round up the weights with the largest remainders, until the sum is 255.
    rank = np.argsort(np.argsort(weight - exact, axis=1, kind="stable"), axis=1, kind="stable")
    weight += rank < (255 - weight.sum(axis=1, keepdims=True))
    return bone.astype(np.uint8), weight.astype(np.uint8)


def without_intersections(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Round positions to int64 multiples of QUANTUM, and smooth them at self-intersections.

    The morph targets press the little toes together.
    """
    average = neighbour_average(F)
    for _ in range(60):
        rounded = np.round(V / QUANTUM).astype(np.int64)
        intersecting = self_intersecting(Mesh(QUANTUM * rounded, F))
        if not intersecting.any():
            return rounded
        near = np.zeros(len(V))
        near[F[intersecting]] = 1.0
        near = np.minimum(1.0, near + average @ near)[:, None]
        V = V + 0.3 * near * (average @ V - V)
    raise InputError("a shape still intersects itself after 60 smoothing steps; change it")


def neighbour_average(F: np.ndarray) -> csr_array:
    """Matrix (n, n) of the mean over each vertex's neighbours."""
    A = igl.adjacency_matrix(F).astype(np.float64)
    return diags_array(1.0 / np.asarray(A.sum(axis=1)).ravel()) @ A


def _relax(V: np.ndarray, F: np.ndarray, *, step: float) -> np.ndarray:
    """Move each vertex towards its neighbours' mean, within its tangent plane."""
    move = step * (neighbour_average(F) @ V - V)
    normal = igl.per_vertex_normals(V, F)
    return V + move - (move * normal).sum(axis=1, keepdims=True) * normal

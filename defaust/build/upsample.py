"""Raise the resolution of a registered mesh by LS3 Loop subdivision and isotropic remeshing."""

from __future__ import annotations

from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from defaust.build.options import BuildOptions
from sshade import InputError, Mesh

#: Ratio of the remeshed vertex count to the count that the target edge length predicts.
COUNT_BIAS = 0.97
#: Maximum number of remeshings to reach the window of vertex counts.
ATTEMPTS = 6


class Upsampled(NamedTuple):
    """A remeshed surface, and facts about the remeshing.

    Attributes
    ----------
    mesh : Mesh
    ls3_steps : int
        Number of subdivisions before the remeshing.
    edge_length : float, optional
        Target edge length of the last remeshing, in the mesh's unit; None without remeshing.
    attempts : int
        Number of remeshings until the vertex count was in the window.
    """

    mesh: Mesh
    ls3_steps: int = 0
    edge_length: float | None = None
    attempts: int = 0


def upsample(mesh: Mesh, options: BuildOptions) -> Upsampled:
    """Resample a closed surface to about a given number of vertices.

    The result is deterministic for fixed versions of the libraries.

    Parameters
    ----------
    mesh : Mesh
        Closed, manifold, consistently oriented, one component.
    options : BuildOptions
        Without `target_vertices` the mesh is kept; it may then have holes.

    Raises
    ------
    InputError
        When the mesh does not fit, the window is missed, or the remeshing changes the topology because the
        vertices are too few for thin parts.

    References
    ----------
    S. Boye, G. Guennebaud, C. Schlick, "Least squares subdivision surfaces", 2010.
    M. Botsch, L. Kobbelt, "A remeshing approach to multiresolution modeling", 2004.
    """
    target, (low, high) = options.target_vertices, options.window
    if target is None:
        return Upsampled(mesh)
    _require_closed(mesh)
    steps = options.ls3_steps
    if steps is None:
        steps = max(0, round(float(np.log(target / mesh.n) / np.log(4.0))))
    fine = subdivide(mesh, steps=steps)
    # Edge length of an equilateral triangulation of the area, with two faces for each vertex.
    length = float(np.sqrt(4.0 / np.sqrt(3.0) * mesh.area / (2.0 * (target / COUNT_BIAS))))
    counts = []
    for attempt in range(1, ATTEMPTS + 1):
        remeshed = remesh(fine, edge_length=length, iterations=options.remesh_iterations)
        counts.append(len(remeshed[0]))
        if low * target <= counts[-1] <= high * target:
            return Upsampled(_checked(*remeshed, original=mesh), steps, length, attempt)
        length *= float(np.sqrt(counts[-1] / target))
    raise InputError(
        f"remeshing to {target} vertices gave {counts}, never {low:g} to {high:g} times that; "
        "choose another target_vertices, a wider window, or another number of ls3_steps"
    )


def subdivide(mesh: Mesh, *, steps: int) -> Mesh:
    """Apply LS3 Loop subdivision to all edges; return the mesh itself if `steps` is 0."""
    if steps == 0:
        return mesh
    pymeshlab, meshes = _mesh_set(mesh)
    # The default threshold, 1 % of the diagonal, would keep short edges unsplit.
    meshes.meshing_surface_subdivision_ls3_loop(
        iterations=steps, threshold=pymeshlab.PureValue(0), selected=False
    )
    return Mesh(*_arrays(meshes))


def remesh(mesh: Mesh, *, edge_length: float, iterations: int) -> tuple[np.ndarray, np.ndarray]:
    """Remesh isotropically; return vertices and faces, not yet checked."""
    pymeshlab, meshes = _mesh_set(mesh)
    # MeshLab reads parameters that are not given from memory that nothing has set. One build of ten was then
    # another mesh.
    meshes.meshing_isotropic_explicit_remeshing(
        iterations=iterations,
        targetlen=pymeshlab.PureValue(edge_length),
        maxsurfdist=pymeshlab.PercentageValue(1),
        featuredeg=30.0,
        selectedonly=False,
        adaptive=False,
        checksurfdist=True,
        splitflag=True,
        collapseflag=True,
        swapflag=True,
        smoothflag=True,
        reprojectflag=True,
    )
    return _arrays(meshes)


def self_intersecting(mesh: Mesh) -> np.ndarray:
    """Mark the faces that intersect another face, (m,) bool."""
    _, meshes = _mesh_set(mesh)
    meshes.compute_selection_by_self_intersections_per_face()
    return meshes.current_mesh().face_selection_array()


def _require_closed(mesh: Mesh) -> None:
    mesh.require_manifold()
    mesh.require_one_component()
    if not mesh.is_closed:
        raise InputError(
            f"the mesh has {len(mesh.boundary_edges)} boundary edges; only closed surfaces can be upsampled, "
            "target_vertices=null keeps the registered resolution"
        )


def _checked(V: np.ndarray, F: np.ndarray, *, original: Mesh) -> Mesh:
    try:
        mesh = Mesh(V, F)
        _require_closed(mesh)
    except InputError as error:
        raise InputError(f"remeshing to {len(V)} vertices broke the surface: {error}") from error
    if mesh.topology != original.topology:
        raise InputError(
            f"remeshing to {mesh.n} vertices changed the Euler characteristic from "
            f"{original.topology.euler} to {mesh.topology.euler}; choose more target_vertices"
        )
    return mesh


def _mesh_set(mesh: Mesh) -> tuple[ModuleType, Any]:
    """Return pymeshlab and its copy of a mesh; raise InputError if pymeshlab lacks a system library."""
    try:
        import pymeshlab
    except ModuleNotFoundError:
        raise
    except ImportError as error:
        raise InputError(
            f"pymeshlab, which refines meshes, cannot be loaded ({error}); on Debian and Ubuntu install "
            "libgl1, which is the library most often missing"
        ) from error
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(mesh.V, mesh.F))
    return pymeshlab, meshes


def _arrays(meshes: Any) -> tuple[np.ndarray, np.ndarray]:
    current = meshes.current_mesh()
    return current.vertex_matrix().copy(), current.face_matrix().astype(np.int64)

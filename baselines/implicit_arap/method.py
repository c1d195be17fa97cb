"""Implicit-ARAP as a method: from a task to deformed vertices.

Proof: the energy of the paper, and of the authors' code, in loops (tests/baselines/test_implicit_arap.py).
Outside the tests, networks, SDF fit, patches and optimiser were compared with the authors' code with the same
weights: outputs agree within 1.2e-6, patches within 2e-15, a step of Adam within 1e-14.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from baselines.hard_handles import require_hard
from baselines.implicit_arap.patch_edges import Weights
from baselines.iteration import handle_error
from baselines.stopwatch import Stopwatch
from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.mesh.mesh import Mesh
from sshade.problem.task import DeformationResult, DeformationTask

if TYPE_CHECKING:
    import torch

#: Largest absolute coordinate of a normalised mesh.
HALF_EXTENT = 0.8


def implicit_arap(
    task: DeformationTask,
    *,
    variant: str = "paper",
    sdf: Literal["network", "grid"] = "network",
    sdf_steps: int = 10_000,
    sdf_points: int = 16_384,
    sdf_learning_rate: float = 1e-4,
    sdf_width: int = 256,
    sdf_layers: int = 8,
    grid_size: int = 128,
    width: int = 256,
    layers: int = 8,
    frequencies: int = 6,
    steps: int = 1000,
    surface_patches: int = 1000,
    space_patches: int = 1000,
    patch_points: int = 30,
    patch_radius: float = 0.03,
    weights: Weights = "cotangents",
    projections: int = 5,
    moving_weight: float = 1000.0,
    static_weight: float = 1000.0,
    arap_weight: float = 10.0,
    learning_rate: float = 1e-3,
    milestones: tuple[int, ...] = (1000, 2000, 5000),
    decay: float = 0.5,
    chunk: int = 300_000,
    device: str = "auto",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Train a field of rigid motions on the level sets of the mesh's SDF, and move the mesh with it.

    The mesh should be closed, because its winding number decides the sign of the distance. Handles are soft
    and end near their targets. The defaults are the published sizes. Lengths are in normalised coordinates:
    the centroid of the surface is the origin, and the largest absolute coordinate is 0.8.

    Parameters
    ----------
    task : DeformationTask
    variant : str
        Name of this set of sizes, written to the row. It does not change the result.
    sdf : "network" or "grid"
        Signed distance: the paper's fitted network, or distances interpolated on a grid, which is faster.
    sdf_steps, sdf_points, sdf_learning_rate, sdf_width, sdf_layers
        Training of the SDF network: steps, points on the surface (and equally many in the cube) in each step,
        learning rate, width and number of layers.
    grid_size : int
        Nodes of the grid along an axis.
    width, layers : int
        Width and number of layers of the field's network.
    frequencies : int
        Octaves of the Fourier features of all networks.
    steps : int
        Training steps of the field.
    surface_patches : int
        Patches on the zero set in each step. One lies at each handle. The other patches, at least a
        quarter, lie at random places.
    space_patches : int
        Patches in each step on the level sets through random points of the cube.
    patch_points, patch_radius
        Number of points of a patch, its centre included, and its radius.
    weights : "cotangents" or "authors"
        Weights of the edges of a patch: the cotangents opposite an edge, or the weights of the authors' code;
        see :func:`baselines.implicit_arap.patch_edges.weighted_edges`. Over 400 patches, the energy with the
        authors' weights was 8.6 times as large in the mean, and no `arap_weight` makes the two equal.
    projections : int
        Number of projection steps to a level set.
    moving_weight, static_weight, arap_weight : float
        Weights of the three losses. The ARAP loss is a mean over patches of a sum over edges.
    learning_rate, milestones, decay
        Adam's learning rate. At each milestone it is multiplied by `decay`.
    chunk : int
        Number of vertices moved at once. Lower it if memory runs out.
    device : str
        Device of torch, or "auto": the GPU if there is one.

    Returns
    -------
    DeformationResult
        `converged` is None. `extra` holds the sizes, the mean handle error divided by the diagonal, and
        ``loss_curve`` (steps, 3), the weighted losses of ARAP, moving handles and static handles.

    Raises
    ------
    ImportError
        If torch is not installed.
    InputError
        If `sdf` or `weights` is unknown, a network has fewer than two layers, a patch has fewer than
        three points, or a handle is soft.

    References
    ----------
    D. Baieri, F. Maggioli, Z. Laehner, S. Melzi, E. Rodola, "Implicit-ARAP: Efficient Handle-Guided
    Deformation of High-Resolution Meshes and Neural Fields via Local Patch Meshing", 2024.
    """
    if sdf not in ("network", "grid"):
        raise InputError(f"sdf={sdf!r} is unknown; use 'network' or 'grid'")
    if weights not in get_args(Weights):
        raise InputError(f"weights={weights!r} is unknown; use 'cotangents' or 'authors'")
    if min(layers, sdf_layers) < 2 or patch_points < 3:
        raise InputError(
            f"networks have {min(layers, sdf_layers)} layers and patches {patch_points} points; use at least "
            "two layers and three points"
        )
    mesh, handles = task.mesh, task.handles
    require_hard(handles, "Implicit-ARAP")
    import torch

    from baselines.implicit_arap.networks import MotionField
    from baselines.implicit_arap.sdf import ImplicitSurface, Sdf, fit_network_sdf, grid_sdf
    from baselines.implicit_arap.training import HandleConstraints, Plan, displacements, train

    plan = Plan(
        steps=steps,
        surface_patches=surface_patches,
        space_patches=space_patches,
        patch_points=patch_points,
        patch_radius=patch_radius,
        weights=weights,
        projections=projections,
        moving_weight=moving_weight,
        static_weight=static_weight,
        arap_weight=arap_weight,
        learning_rate=learning_rate,
        milestones=milestones,
        decay=decay,
    )
    place = torch.device(("cuda" if torch.cuda.is_available() else "cpu") if device == "auto" else device)
    draws, initial = torch.Generator(place).manual_seed(seed), torch.Generator().manual_seed(seed)
    watch = Stopwatch()
    V, centre, scale = normalised(mesh)
    distance: Sdf
    facts: dict[str, Any] = {"sdf_size": grid_size}
    if sdf == "grid":
        progress("sdf", 0, 1, f"{grid_size}^3 distances")
        distance = grid_sdf(V, mesh.F, size=grid_size, device=place)
        progress("sdf", 1, 1, f"{grid_size}^3 distances")
    else:
        surface = ImplicitSurface.of(V, mesh.F, device=place)
        distance, loss = fit_network_sdf(
            surface,
            width=sdf_width,
            layers=sdf_layers,
            frequencies=frequencies,
            steps=sdf_steps,
            points=sdf_points,
            learning_rate=sdf_learning_rate,
            generator=draws,
            weights=initial,
            progress=progress,
        )
        facts |= {"sdf_size": sdf_width, "sdf_steps": sdf_steps, "sdf_loss_last": loss}
    watch.end("sdf")

    def tensor(points: np.ndarray) -> torch.Tensor:
        return torch.tensor(points, dtype=torch.float32, device=place)

    rest, target = tensor(V[handles.index]), tensor((handles.target - centre) * scale)
    constraints = HandleConstraints.of(distance, rest, target, handles.dynamic, repeats=projections)
    network = MotionField(width=width, layers=layers, frequencies=frequencies, generator=initial)
    network = network.to(place)
    rng = np.random.default_rng(seed)
    losses = train(network, distance, constraints, plan, rng=rng, generator=draws, progress=progress)
    watch.end("field")

    vertices = mesh.V + displacements(network, tensor(V), chunk=chunk) / scale
    watch.end("apply")
    facts |= {"variant": variant, "sdf": sdf, "steps": steps}
    facts |= {"device": torch.cuda.get_device_name(place) if place.type == "cuda" else place.type}
    facts |= {"points": plan.points(len(handles)), "threads": torch.get_num_threads()}
    facts |= {"handle_error": handle_error(mesh, handles, vertices), "loss_curve": losses}
    return DeformationResult(vertices, steps, converged=None, seconds=watch.seconds, extra=facts)


def normalised(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, float]:
    """Centre a mesh at the area-weighted centroid of its surface and scale its largest coordinate to 0.8.

    Returns
    -------
    V : (n, 3) float64
        ``(mesh.V - centre) * scale``.
    centre : (3,) float64
    scale : float
    """
    # Measure from the centre of the box, because the centroid would lose digits far from the origin.
    middle = 0.5 * (mesh.V.min(axis=0) + mesh.V.max(axis=0))
    barycentres = (mesh.V - middle)[mesh.F].mean(axis=1)
    centre = middle + mesh.face_areas @ barycentres / mesh.area
    scale = HALF_EXTENT / np.abs(mesh.V - centre).max()
    return (mesh.V - centre) * scale, centre, float(scale)

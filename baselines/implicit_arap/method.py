"""Implicit-ARAP as a method: from a task to deformed vertices."""

from __future__ import annotations

from time import perf_counter
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from sshade.mesh.mesh import Mesh
from sshade.task import DeformationResult, DeformationTask, Progress, silent

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

    The mesh should be closed: the sign of the distance is its winding number. Handles are soft, so
    they end near their targets. The defaults are the published sizes; lengths are in the
    normalised coordinates, where the centroid of the surface is the origin and the largest
    coordinate is 0.8.

    Parameters
    ----------
    task : DeformationTask
    variant : str
        A name for this choice of sizes, for the row; it changes nothing.
    sdf : "network" or "grid"
        The paper's fitted network, or distances on a grid in its place.
    sdf_steps, sdf_points, sdf_learning_rate, sdf_width, sdf_layers
        Fit of the network; points on the surface, and as many in the cube, per step.
    grid_size : int
        Nodes of the grid along an axis.
    width, layers : int
        Of the field's network.
    frequencies : int
        Octaves of the Fourier features of all networks.
    steps : int
    surface_patches : int
        Patches on the zero set per step: one at each handle, the rest (a quarter at least) anywhere.
    space_patches : int
        Patches on the level sets through points of the cube.
    patch_points, patch_radius
        Points of a patch with its centre, and its radius.
    projections : int
        Steps towards a level set.
    moving_weight, static_weight, arap_weight : float
        Of the three losses. The ARAP loss is a mean over patches of a sum over edges.
    learning_rate, milestones, decay
        Of Adam; after each milestone the rate is multiplied by `decay`.
    chunk : int
        Vertices moved at once.
    device : str
        A device of torch, or "auto": a GPU if there is one.

    Returns
    -------
    DeformationResult
        `converged` is None. `extra` holds the sizes, first and last losses and the mean handle error
        over the diagonal, and ``loss_curve`` (steps, 3): weighted losses of ARAP, moving and static
        handles.

    Raises
    ------
    ImportError
        When torch is not installed.
    ValueError
        When a network has fewer than two layers, or a patch fewer than three points.

    References
    ----------
    D. Baieri, F. Maggioli, Z. Laehner, S. Melzi, E. Rodola, "Implicit-ARAP: Efficient Handle-Guided
    Deformation of High-Resolution Meshes and Neural Fields via Local Patch Meshing", 2024.
    """
    torch = _torch()
    from baselines.implicit_arap.networks import MotionField
    from baselines.implicit_arap.training import Constraints, Plan, displacements, train

    if min(layers, sdf_layers) < 2 or patch_points < 3:
        raise ValueError(
            f"networks need two layers and patches three points, "
            f"not {min(layers, sdf_layers)} and {patch_points}"
        )
    plan = Plan(
        steps=steps,
        surface_patches=surface_patches,
        space_patches=space_patches,
        patch_points=patch_points,
        patch_radius=patch_radius,
        projections=projections,
        moving_weight=moving_weight,
        static_weight=static_weight,
        arap_weight=arap_weight,
        learning_rate=learning_rate,
        milestones=tuple(milestones),
        decay=decay,
    )
    fit = {"width": sdf_width, "layers": sdf_layers, "steps": sdf_steps, "points": sdf_points}
    fit |= {"learning_rate": sdf_learning_rate, "frequencies": frequencies}
    place = torch.device(("cuda" if torch.cuda.is_available() else "cpu") if device == "auto" else device)
    draws = _Draws(torch.Generator(place).manual_seed(seed), torch.Generator().manual_seed(seed))
    mesh, handles = task.mesh, task.handles

    begin = perf_counter()
    V, centre, scale = normalised(mesh)
    fit = {"size": grid_size} if sdf == "grid" else fit
    distance, facts = _distance(sdf, V, mesh.F, fit, draws=draws, progress=progress)
    fitted = perf_counter()

    def tensor(points: np.ndarray) -> torch.Tensor:
        return torch.tensor(points, dtype=torch.float32, device=place)

    rest, target = tensor(V[handles.index]), tensor((handles.target - centre) * scale)
    constraints = Constraints.of(distance, rest, target, handles.dynamic, repeats=projections)
    sizes = {"width": width, "layers": layers, "frequencies": frequencies}
    network = MotionField(**sizes, generator=draws.weights).to(place)
    rng = np.random.default_rng(seed)
    losses = train(network, distance, constraints, plan, rng=rng, generator=draws.points, progress=progress)
    trained = perf_counter()

    vertices = mesh.V + displacements(network, tensor(V), chunk=chunk) / scale
    seconds = {"sdf": fitted - begin, "field": trained - fitted, "apply": perf_counter() - trained}
    facts |= {"variant": variant, "sdf": sdf, "steps": steps}
    facts |= {"points": plan.points(len(handles)), **_device_facts(place), **_loss_facts(losses)}
    facts |= {"handle_error": _handle_error(task, vertices), "loss_curve": losses}
    return DeformationResult(
        vertices=vertices, iterations=steps, converged=None, seconds=seconds, extra=facts
    )


class _Draws(NamedTuple):
    """Generators for points, on the device, and for initial weights, on the CPU."""

    points: torch.Generator
    weights: torch.Generator


def normalised(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, float]:
    """Vertices about the area-weighted centroid of the surface, with largest coordinate 0.8.

    Returns
    -------
    V : (n, 3) float64
        ``(mesh.V - centre) * scale``.
    centre : (3,) float64
    scale : float
    """
    # From the middle of the box: far from the origin the centroid would lose digits.
    middle = 0.5 * (mesh.V.min(axis=0) + mesh.V.max(axis=0))
    barycentres = (mesh.V - middle)[mesh.F].mean(axis=1)
    centre = middle + mesh.face_areas @ barycentres / mesh.area
    scale = HALF_EXTENT / np.abs(mesh.V - centre).max()
    return (mesh.V - centre) * scale, centre, float(scale)


def _torch() -> Any:
    try:
        import torch
    except ModuleNotFoundError as error:
        raise ImportError("implicit_arap needs PyTorch; pip install 'sshade[torch]'") from error
    return torch


def _distance(
    kind: str,
    V: np.ndarray,
    F: np.ndarray,
    settings: dict[str, Any],
    *,
    draws: _Draws,
    progress: Progress,
) -> tuple[Any, dict[str, Any]]:
    """The SDF of a kind, and facts about it for the row."""
    from baselines.implicit_arap.sdf import Surface, fit_network_sdf, grid_sdf

    device = draws.points.device
    if kind == "grid":
        progress("sdf", 0, 1, f"{settings['size']}^3 distances")
        distance = grid_sdf(V, F, device=device, **settings)
        progress("sdf", 1, 1, f"{settings['size']}^3 distances")
        return distance, {"sdf_size": settings["size"]}
    surface = Surface.of(V, F, device=device)
    distance, loss = fit_network_sdf(
        surface, generator=draws.points, weights=draws.weights, progress=progress, **settings
    )
    return distance, {"sdf_size": settings["width"], "sdf_steps": settings["steps"], "sdf_loss_last": loss}


def _device_facts(device: torch.device) -> dict[str, Any]:
    import torch

    name = torch.cuda.get_device_name(device) if device.type == "cuda" else device.type
    return {"device": name, "threads": torch.get_num_threads()}


def _loss_facts(losses: np.ndarray) -> dict[str, float]:
    """Of the total and of each part; the last ones as a mean of ten steps, each with its own patches."""
    if not len(losses):
        return {}
    total, last = losses.sum(axis=1), losses[-10:].mean(axis=0)
    return {
        "loss_first": float(total[0]),
        "loss_last": float(total[-10:].mean()),
        "loss_arap": float(last[0]),
        "loss_moving": float(last[1]),
        "loss_static": float(last[2]),
    }


def _handle_error(task: DeformationTask, vertices: np.ndarray) -> float:
    gaps = np.linalg.norm(vertices[task.handles.index] - task.handles.target, axis=1)
    return float(gaps.mean()) / task.mesh.diagonal

"""Signed distances to the rest surface: the paper's network, and a faster grid.

A call returns the values at points; :meth:`with_gradient` also returns gradients. Coordinates are normalised
to the cube [-1, 1]^3. Distances are negative inside the surface.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from baselines.implicit_arap.networks import Mlp
from sshade.core.progress import Progress

#: Width of the Gaussian that smooths the grid's gradient, in voxels.
SMOOTHING = 1.0

#: Weights of the losses of the fit, and the decay of the loss away from the surface.
ON_SURFACE, EIKONAL, NORMALS, AWAY, DECAY = 3000.0, 100.0, 50.0, 3000.0, 100.0


class Sdf(Protocol):
    """A signed distance: values (n,) and gradients (n, 3) at points (n, 3)."""

    def __call__(self, x: Tensor) -> Tensor: ...

    def with_gradient(self, x: Tensor) -> tuple[Tensor, Tensor]: ...


class GridSdf:
    """Distances at the nodes of a regular grid over [-1, 1]^3, with trilinear interpolation.

    The gradient comes from central differences, smoothed with a Gaussian of one voxel. The exact gradient of
    a trilinear function jumps at each voxel face and would crease the patches.

    Parameters
    ----------
    values : (g, g, g) float
        Distance at node (i, j, k), which lies at ``-1 + 2 (i, j, k) / (g - 1)``.
    device : torch.device
    """

    def __init__(self, values: np.ndarray, *, device: torch.device) -> None:
        from scipy.ndimage import gaussian_filter

        gradient = np.gradient(values, 2.0 / (len(values) - 1))
        smooth = [gaussian_filter(part, SMOOTHING, mode="nearest") for part in gradient]
        self._grid = torch.tensor(np.stack([values, *smooth])[None], dtype=torch.float32, device=device)

    def __call__(self, x: Tensor) -> Tensor:
        return self._sample(self._grid[:, :1], x)[0]

    def with_gradient(self, x: Tensor) -> tuple[Tensor, Tensor]:
        value, *gradient = self._sample(self._grid, x)
        return value, torch.stack(gradient, dim=-1)

    @staticmethod
    def _sample(grid: Tensor, x: Tensor) -> Tensor:
        """Return samples (channels, n); grid_sample counts coordinates from the last axis."""
        at = x.flip(-1)[None, :, None, None]
        sampled = functional.grid_sample(grid, at, padding_mode="border", align_corners=True)
        return sampled[0, :, :, 0, 0]


def grid_sdf(V: np.ndarray, F: np.ndarray, *, size: int, device: torch.device) -> GridSdf:
    """Compute the signed distances of a mesh at size^3 nodes, with signs from the winding number.

    Parameters
    ----------
    V : (n, 3) float64
        Normalised vertices.
    F : (m, 3) int64
    size : int
        Nodes along an axis.
    device : torch.device
    """
    import igl

    axis = np.linspace(-1.0, 1.0, size)
    nodes = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    kind = igl.SIGNED_DISTANCE_TYPE_FAST_WINDING_NUMBER
    distance = igl.signed_distance(nodes, np.array(V), np.array(F), sign_type=kind)[0]
    return GridSdf(distance.reshape(size, size, size), device=device)


class NetworkSdf:
    """The paper's SDF: a trained MLP."""

    def __init__(self, network: Mlp) -> None:
        self._network = network.requires_grad_(False)

    def __call__(self, x: Tensor) -> Tensor:
        with torch.no_grad():
            return self._network(x)[..., 0]

    def with_gradient(self, x: Tensor) -> tuple[Tensor, Tensor]:
        with torch.enable_grad():
            x = x.detach().requires_grad_(True)
            value = self._network(x)[..., 0]
            (gradient,) = torch.autograd.grad(value.sum(), x)
        return value.detach(), gradient


class ImplicitSurface(NamedTuple):
    """A mesh prepared for random points: corner positions, unit normals, and cumulative areas."""

    corners: Tensor
    normals: Tensor
    cumulative_area: Tensor

    @classmethod
    def of(cls, V: np.ndarray, F: np.ndarray, *, device: torch.device) -> ImplicitSurface:
        a, b, c = (V[F[:, k]] for k in range(3))
        cross = np.cross(b - a, c - a)
        doubled = np.linalg.norm(cross, axis=1)
        normals = cross / np.where(doubled > 0, doubled, 1)[:, None]
        cumulative = np.cumsum(doubled) / doubled.sum()

        def tensor(array: np.ndarray) -> Tensor:
            return torch.tensor(array, dtype=torch.float32, device=device)

        # Areas are float64, because a float32 sum over a large mesh would skip small faces.
        return cls(tensor(V[F]), tensor(normals), torch.tensor(cumulative, device=device))

    def sample(self, count: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Draw area-uniform points (count, 3); also return the normals (count, 3) of their faces."""
        device = self.corners.device
        u = torch.rand(count, generator=generator, device=device, dtype=torch.float64)
        face = torch.searchsorted(self.cumulative_area, u).clamp(max=len(self.corners) - 1)
        r = torch.rand(2, count, 1, generator=generator, device=device)
        root = r[0].sqrt()
        a, b, c = self.corners[face].unbind(1)
        return (1 - root) * a + root * (1 - r[1]) * b + root * r[1] * c, self.normals[face]


def fit_network_sdf(
    surface: ImplicitSurface,
    *,
    width: int,
    layers: int,
    frequencies: int,
    steps: int,
    points: int,
    learning_rate: float,
    generator: torch.Generator,
    weights: torch.Generator,
    progress: Progress,
) -> tuple[NetworkSdf, float]:
    """Fit an MLP to the signed distance of a surface.

    ``3000 mean|f|`` on the surface, ``100 mean| |grad f| - 1 |`` everywhere, ``50 mean(1 - cos)``
    between gradients and normals, and ``3000 mean exp(-100 |f|)`` off the surface, with Adam.

    Parameters
    ----------
    surface : ImplicitSurface
    width, layers, frequencies : int
        Sizes of the MLP.
    steps : int
        Training steps.
    points : int
        Number of points on the surface in each step; equally many points lie in the cube.
    learning_rate : float
    generator : torch.Generator
        Generator of the points, on the surface's device.
    weights : torch.Generator
        Generator of the initial weights, on the CPU.
    progress : Progress

    Returns
    -------
    sdf : NetworkSdf
    loss : float
        Loss of the last step.
    """
    device = surface.corners.device
    network = Mlp(
        3, 1, width=width, layers=layers, frequencies=frequencies, last="sphere", generator=weights
    ).to(device)
    adam = torch.optim.Adam(network.parameters(), lr=learning_rate)
    loss = torch.tensor(float("nan"))
    for step in range(steps):
        on, normals = surface.sample(points, generator)
        off = 2 * torch.rand(points, 3, generator=generator, device=device) - 1
        loss = _fit_loss(network, on, normals, off)
        adam.zero_grad()
        loss.backward()
        adam.step()
        report(progress, "sdf", step, steps, loss)
    return NetworkSdf(network), loss.item()


def _fit_loss(network: Mlp, on: Tensor, normals: Tensor, off: Tensor) -> Tensor:
    x = torch.cat([on, off]).requires_grad_(True)
    f = network(x)[..., 0]
    (gradient,) = torch.autograd.grad(f.sum(), x, create_graph=True)
    k = len(on)
    cosine = functional.cosine_similarity(gradient[:k], normals, dim=-1)
    return (
        ON_SURFACE * f[:k].abs().mean()
        + EIKONAL * (gradient.norm(dim=-1) - 1).abs().mean()
        + NORMALS * (1 - cosine).mean()
        + AWAY * torch.exp(-DECAY * f[k:].abs()).mean()
    )


def report(progress: Progress, stage: str, step: int, steps: int, loss: Tensor) -> None:
    """Report every tenth step only, because reading the loss interrupts a GPU."""
    if step % 10 == 9 or step == steps - 1:
        progress(stage, step + 1, steps, f"loss {loss.item():.3g}")

"""Training a deformation field: as rigid as possible on patches, with soft handles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from baselines.implicit_arap.networks import moved
from baselines.implicit_arap.patch_edges import Weights
from baselines.implicit_arap.patches import patches_at, project, random_pattern, zero_set
from baselines.implicit_arap.sdf import Sdf, report
from sshade.core.progress import Progress

#: Least fraction of the surface patches that lie at random places, however many handles there are.
RANDOM = 0.25


class Plan(NamedTuple):
    """Sizes and weights of a training run, named like the parameters of the method."""

    steps: int
    surface_patches: int
    space_patches: int
    patch_points: int
    patch_radius: float
    weights: Weights
    projections: int
    moving_weight: float
    static_weight: float
    arap_weight: float
    learning_rate: float
    milestones: tuple[int, ...]
    decay: float

    def random_patches(self, handles: int) -> int:
        """Return the number of patches at random places of the surface."""
        return max(self.surface_patches - handles, round(RANDOM * self.surface_patches))

    def points(self, handles: int) -> int:
        """Return the number of points at which a step evaluates the field."""
        return (handles + self.random_patches(handles) + self.space_patches) * self.patch_points


class HandleConstraints(NamedTuple):
    """Places of handles (h, 3) on the zero set and their targets; moving handles come first."""

    at: Tensor
    target: Tensor
    moving: int

    @classmethod
    def of(
        cls, sdf: Sdf, rest: Tensor, target: Tensor, dynamic: np.ndarray, *, repeats: int
    ) -> HandleConstraints:
        """Project handles onto the zero set. Targets of static handles are their projections."""
        order = torch.as_tensor(np.argsort(~dynamic, kind="stable"), device=rest.device)
        at = project(sdf, rest[order], repeats=repeats)
        moving = int(dynamic.sum())
        return cls(at, torch.cat([target[order][:moving], at[moving:]]), moving)


def train(
    field: nn.Module,
    sdf: Sdf,
    constraints: HandleConstraints,
    plan: Plan,
    *,
    rng: np.random.Generator,
    generator: torch.Generator,
    progress: Progress,
) -> np.ndarray:
    """Train a field in place.

    Parameters
    ----------
    field : Module
        Network on the device of the constraints.
    sdf : Sdf
    constraints : HandleConstraints
    plan : Plan
    rng : numpy.random.Generator
        Generator of the patterns.
    generator : torch.Generator
        Generator of the points, on the device of the constraints.
    progress : Progress

    Returns
    -------
    (steps, 3) float32
        Weighted losses of each step: ARAP, moving handles, static handles.
    """
    adam = torch.optim.Adam(field.parameters(), lr=plan.learning_rate)
    schedule = torch.optim.lr_scheduler.MultiStepLR(adam, list(plan.milestones), gamma=plan.decay)
    losses = torch.zeros(plan.steps, 3, device=constraints.at.device)
    for step in range(plan.steps):
        parts = _losses(field, sdf, constraints, plan, rng=rng, generator=generator)
        adam.zero_grad()
        parts.sum().backward()
        adam.step()
        schedule.step()
        losses[step] = parts.detach()
        report(progress, "field", step, plan.steps, losses[step].sum())
    return losses.cpu().numpy()


def _losses(
    field: nn.Module,
    sdf: Sdf,
    constraints: HandleConstraints,
    plan: Plan,
    *,
    rng: np.random.Generator,
    generator: torch.Generator,
) -> Tensor:
    """Return the three weighted losses of one step on new patches."""
    device = constraints.at.device
    h, moving = len(constraints.at), constraints.moving
    with torch.no_grad():
        size = plan.patch_points, plan.patch_radius
        pattern = random_pattern(*size, rng, weights=plan.weights, device=device)
        surface = zero_set(sdf, plan.random_patches(h), repeats=plan.projections, generator=generator)
        space = 2 * torch.rand(plan.space_patches, 3, generator=generator, device=device) - 1
        centres = torch.cat([constraints.at, surface, space])
        patches = patches_at(sdf, centres, pattern, repeats=plan.projections)
    R, t = field(patches)
    images = moved(patches, R, t)
    gap = (images[:h, 0] - constraints.target).square()
    zero = gap.new_zeros(())
    return torch.stack(
        [
            plan.arap_weight * pattern.energy(patches, R, images),
            plan.moving_weight * gap[:moving].mean() if moving else zero,
            plan.static_weight * gap[moving:].mean() if moving < h else zero,
        ]
    )


@torch.no_grad()
def displacements(field: nn.Module, x: Tensor, *, chunk: int) -> np.ndarray:
    """Return the displacements (n, 3) float64 of points (n, 3), computed `chunk` points at a time."""
    parts = [(moved(part, *field(part)) - part).cpu().numpy() for part in x.split(chunk)]
    return np.concatenate(parts).astype(np.float64)

"""The networks of Implicit-ARAP: an MLP on Fourier features, and a field of rigid motions.

A field is a module that maps a point x to a rotation R(x) and a translation t(x), and moves it to
``R(x) x + t(x)``. It starts as the identity. Random weights come from a generator that the caller seeds;
torch's global generator is not used.
"""

from __future__ import annotations

from itertools import pairwise
from math import pi, sqrt
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

#: Sharpness of the Softplus activations, which are close to a ReLU but twice differentiable.
BETA = 100.0


def fourier_features(x: Tensor, frequencies: int) -> Tensor:
    """``[x, sin(2 pi 2^k x), cos(2 pi 2^k x)]`` for k = 0 .. frequencies - 1.

    Parameters
    ----------
    x : (..., d) float32
    frequencies : int

    Returns
    -------
    (..., d (1 + 2 frequencies)) float32
    """
    scales = 2 * pi * 2.0 ** torch.arange(frequencies, device=x.device, dtype=x.dtype)
    angles = (x[..., None] * scales).flatten(-2)
    return torch.cat([x, angles.sin(), angles.cos()], dim=-1)


class WeightNormLinear(nn.Module):
    """A linear layer whose rows are stored as direction and length (Salimans and Kingma, 2016).

    Parameters
    ----------
    weight : (out, in) float32
        Initial value.
    bias : (out,) float32
    """

    def __init__(self, weight: Tensor, bias: Tensor) -> None:
        super().__init__()
        self.direction = nn.Parameter(weight)
        self.length = nn.Parameter(weight.norm(dim=1, keepdim=True))
        self.bias = nn.Parameter(bias)

    def forward(self, x: Tensor) -> Tensor:
        weight = self.direction * (self.length / self.direction.norm(dim=1, keepdim=True))
        return functional.linear(x, weight, self.bias)


class Mlp(nn.Module):
    """Fourier features, then linear layers with Softplus between them.

    The middle layer receives the input features again, in front of the hidden vector; the paper uses layer 4
    of 8.

    The geometric initialisation (Atzmon and Lipman, 2020) uses only the raw coordinates. With
    ``last="sphere"`` the network starts near the signed distance to a sphere of radius 0.5; with
    ``last="zero"`` it starts at zero.

    Parameters
    ----------
    inputs, outputs : int
    width, layers : int
        Number of linear layers, and number of outputs of all layers except the last.
    frequencies : int
    last : "sphere" or "zero"
    generator : torch.Generator
        Generator on the CPU.
    """

    def __init__(
        self,
        inputs: int,
        outputs: int,
        *,
        width: int,
        layers: int,
        frequencies: int,
        last: Literal["sphere", "zero"],
        generator: torch.Generator,
    ) -> None:
        super().__init__()
        self.frequencies, self.skip = frequencies, layers // 2
        features = inputs * (1 + 2 * frequencies)
        sizes = [features, *[width] * (layers - 1)]
        hidden = []
        for number, (before, after) in enumerate(pairwise(sizes)):
            extra = features if number == self.skip else 0
            weight = torch.randn(after, extra + before, generator=generator) * sqrt(2 / after)
            if number in (0, self.skip):
                weight[:, inputs:features] = 0
            hidden.append(WeightNormLinear(weight, torch.zeros(after)))
        self.hidden = nn.ModuleList(hidden)
        end = width + (features if self.skip == layers - 1 else 0)
        if last == "zero":
            # The field starts as the identity. torch's own initialisation would draw random numbers.
            self.last: nn.Module = nn.utils.skip_init(nn.Linear, end, outputs)
            for parameter in self.last.parameters():
                nn.init.zeros_(parameter)
        else:
            noise = 1e-4 * torch.randn(outputs, end, generator=generator)
            self.last = WeightNormLinear(sqrt(pi / end) + noise, torch.full((outputs,), -0.5))

    def forward(self, x: Tensor) -> Tensor:
        features = fourier_features(x, self.frequencies)
        h = features
        for number, layer in enumerate([*self.hidden, self.last]):
            if number == self.skip:
                h = torch.cat([features, h], dim=-1)
            h = layer(h)
            if number < len(self.hidden):
                h = functional.softplus(h, beta=BETA)
        return h


def euler_rotation(angles: Tensor) -> Tensor:
    """Return ``R_x R_y R_z``, the product of the rotations about the axes.

    Parameters
    ----------
    angles : (..., 3) float32, radians

    Returns
    -------
    (..., 3, 3) float32
        Computed from the unit quaternion of the half angles.
    """
    (cx, cy, cz), (sx, sy, sz) = (angles / 2).cos().unbind(-1), (angles / 2).sin().unbind(-1)
    w = cx * cy * cz - sx * sy * sz
    x = sx * cy * cz + cx * sy * sz
    y = cx * sy * cz - sx * cy * sz
    z = cx * cy * sz + sx * sy * cz
    rows = [
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    ]
    return torch.stack(rows, dim=-1).unflatten(-1, (3, 3))


def moved(x: Tensor, R: Tensor, t: Tensor) -> Tensor:
    """Return ``R x + t`` for each point."""
    return (R @ x[..., None])[..., 0] + t


class MotionField(nn.Module):
    """The field of the paper's mesh pipeline: one MLP returns three Euler angles and a translation."""

    def __init__(self, *, width: int, layers: int, frequencies: int, generator: torch.Generator) -> None:
        super().__init__()
        self.mlp = Mlp(
            3, 6, width=width, layers=layers, frequencies=frequencies, last="zero", generator=generator
        )

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return R (..., 3, 3) and t (..., 3) at points x (..., 3)."""
        out = self.mlp(x)
        return euler_rotation(out[..., :3]), out[..., 3:]

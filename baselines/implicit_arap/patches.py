"""Small triangulated patches on the level sets of an SDF, and the ARAP energy on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from baselines.implicit_arap.patch_edges import Weights, weighted_edges
from baselines.implicit_arap.sdf import Sdf

#: Number of random points in each search for the zero set.
DRAW = 10_000
#: Maximum number of searches.
DRAWS = 2000
#: Distance at which a point counts as near the zero set, in normalised units.
NEAR = 0.01
#: Least area that a cotangent divides by, in normalised units, because random patterns have slivers.
LEAST_AREA = 1e-6


@dataclass(frozen=True)
class Pattern:
    """A planar triangulation that all patches of a step share; its vertex 0 is the centre.

    Parameters
    ----------
    points : (p, 2) float32
    triangles : (m, 3) int64
    corner_to_edge : (3 m, e) float32
        Number of times that the cotangent at a corner adds to the weight of a directed edge. Corners are in
        the order of ``triangles.T.ravel()``.
    difference : (e, p) float32
        Each row is 1 at the edge's source and -1 at its target.
    source : (e, p) float32
        Each row is 1 at the edge's source.
    """

    points: Tensor
    triangles: Tensor
    corner_to_edge: Tensor
    difference: Tensor
    source: Tensor

    def weights(self, patches: Tensor) -> Tensor:
        """Return the weights (b, e) of the directed edges of patches (b, p, 3)."""
        corners = torch.cat([_cotangent(patches[:, self.triangles.roll(-k, 1)]) for k in range(3)], dim=1)
        return corners @ self.corner_to_edge

    def energy(self, patches: Tensor, R: Tensor, images: Tensor) -> Tensor:
        """Return the mean over patches of ``sum_ab w_ab |R_a (p_a - p_b) - (x'_a - x'_b)|^2``.

        Parameters
        ----------
        patches, images : (b, p, 3) float32
            Points p at rest and their images x'.
        R : (b, p, 3, 3) float32

        Returns
        -------
        () float32
        """
        e = self.difference @ patches
        image = self.difference @ images
        # Multiply by constant matrices: the backward pass of indexing is slow, and GPUs sum in random order.
        rotation = (self.source @ R.flatten(2)).unflatten(2, (3, 3))
        stretch = (rotation @ e[..., None])[..., 0] - image
        return (self.weights(patches) * stretch.square().sum(dim=-1)).sum(dim=1).mean()


def random_pattern(
    points: int,
    radius: float,
    rng: np.random.Generator,
    *,
    weights: Weights = "cotangents",
    device: torch.device | str = "cpu",
) -> Pattern:
    """Draw points uniformly in a disc and triangulate them and the origin by Delaunay's method.

    Parameters
    ----------
    points : int
        Number of points, the origin included; the paper uses 30.
    radius : float
        Radius of the disc in normalised units; the paper uses 0.03.
    rng : numpy.random.Generator
    weights : {"cotangents", "authors"}
        See :func:`baselines.implicit_arap.patch_edges.weighted_edges`.
    device : torch.device or str
    """
    from scipy.spatial import Delaunay

    r, angle = radius * np.sqrt(rng.random(points - 1)), 2 * np.pi * rng.random(points - 1)
    around = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)
    plane = np.concatenate([np.zeros((1, 2)), around])
    return pattern_of(plane, Delaunay(plane).simplices, weights=weights, device=device)


def pattern_of(
    plane: np.ndarray,
    triangles: np.ndarray,
    *,
    weights: Weights = "cotangents",
    device: torch.device | str = "cpu",
) -> Pattern:
    """Build a pattern of points and triangles.

    Parameters
    ----------
    plane : (p, 2) float64
    triangles : (m, 3) int
    weights : {"cotangents", "authors"}
        See :func:`baselines.implicit_arap.patch_edges.weighted_edges`.
    device : torch.device or str
    """
    triangles = np.asarray(triangles, dtype=np.int64)
    edges, corners = weighted_edges(triangles, weights)
    row = np.arange(len(edges))
    source = np.zeros((len(edges), len(plane)))
    source[row, edges[:, 0]] = 1
    difference = source.copy()
    difference[row, edges[:, 1]] = -1

    def tensor(array: np.ndarray) -> Tensor:
        return torch.tensor(array, dtype=torch.float32, device=device)

    return Pattern(
        points=tensor(plane),
        triangles=torch.tensor(triangles, device=device),
        corner_to_edge=tensor(corners),
        difference=tensor(difference),
        source=tensor(source),
    )


def _cotangent(triangle: Tensor) -> Tensor:
    """Return the cotangents at corner 0 of triangles (b, m, 3, 3)."""
    a, b, c = triangle.unbind(2)
    doubled = torch.linalg.cross(b - a, c - a).norm(dim=-1)
    return ((b - a) * (c - a)).sum(dim=-1) / doubled.clamp(min=2 * LEAST_AREA)


def tangents(normal: Tensor) -> tuple[Tensor, Tensor]:
    """Return two unit vectors that form a right-handed frame with each unit normal (b, 3).

    On the upper half of the sphere, the frame is the smallest rotation that takes z to the normal, as in the
    paper. Near -z this rotation is undefined; on the lower half, the frame starts from -z.

    References
    ----------
    T. Duff et al., "Building an orthonormal basis, revisited", 2017.
    """
    x, y, z = normal.unbind(-1)
    sign = torch.where(z < 0, -1.0, 1.0)
    a = -1 / (sign + z)
    b = x * y * a
    first = torch.stack([1 + sign * x * x * a, sign * b, -sign * x], dim=-1)
    return first, torch.stack([b, sign + y * y * a, -y], dim=-1)


def project(sdf: Sdf, x: Tensor, *, level: Tensor | float = 0.0, repeats: int = 5) -> Tensor:
    """Walk points (n, 3) along the gradient to a level set: ``x <- x - (f(x) - level) grad f / |grad f|``.

    Parameters
    ----------
    sdf : Sdf
    x : (n, 3) float32
    level : (n,) float32 or float
    repeats : int
        Number of steps.
    """
    for _ in range(repeats):
        f, gradient = sdf.with_gradient(x)
        x = x - (f - level)[:, None] * torch.nn.functional.normalize(gradient, dim=-1)
    return x


def zero_set(sdf: Sdf, count: int, *, repeats: int, generator: torch.Generator) -> Tensor:
    """Draw points (count, 3) on the zero set: uniform points of the cube near the zero set, projected to it.

    Raises
    ------
    RuntimeError
        If too few points lie near the zero set, because the SDF has no surface inside the cube.
    """
    found, have = [], 0
    for _ in range(DRAWS):
        if have >= count:
            break
        x = 2 * torch.rand(DRAW, 3, generator=generator, device=generator.device) - 1
        found.append(x[sdf(x).abs() < NEAR])
        have += len(found[-1])
    if have < count:
        raise RuntimeError(
            f"only {have} of {DRAW * DRAWS} points lie near the zero set of the SDF; "
            "fit it for more steps, or use sdf=grid"
        )
    near = torch.cat(found)[:count] if found else torch.zeros(0, 3, device=generator.device)
    return project(sdf, near, repeats=repeats)


def patches_at(sdf: Sdf, centres: Tensor, pattern: Pattern, *, repeats: int) -> Tensor:
    """Lay a pattern onto the level sets through points.

    Parameters
    ----------
    sdf : Sdf
    centres : (b, 3) float32
    pattern : Pattern
    repeats : int
        Projections of each point.

    Returns
    -------
    (b, p, 3) float32
        Point 0 of each patch is its centre.
    """
    level, gradient = sdf.with_gradient(centres)
    first, second = tangents(torch.nn.functional.normalize(gradient, dim=-1))
    u, v = pattern.points.T[:, None, :, None]
    flat = centres[:, None] + u * first[:, None] + v * second[:, None]
    p = pattern.points.shape[0]
    laid = project(sdf, flat.reshape(-1, 3), level=level.repeat_interleave(p), repeats=repeats)
    return laid.unflatten(0, (len(centres), p))

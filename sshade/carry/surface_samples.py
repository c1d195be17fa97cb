"""Samples of a surface in levels of spacing, each with the mean motion of the surface around it.

The first level thins points that are spread over the triangles; each further level thins the samples of the
level before, at twice the spacing. A sample suppresses samples within the spacing whose normals point to its
side, so that both walls of a thin sheet keep samples. Distances along the normals count more, so that layers
keep samples of their own while the spacing is smaller than 3/2 of the gap. Suppressed samples belong to the
nearest remaining one, which takes the mean of their maps, weighted by area.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sshade.carry.trees import box_tree, curve_order
from sshade.kernels import kernel, subroutine
from sshade.mesh.ids import numbered

#: Spacing of the first level, over the root of the area of a triangle that most of the surface exceeds.
SPACING = 1.5
#: Portion of the surface with smaller triangles.
SMALLER = 0.1
#: Least number of points per spacing squared, number of points for each triangle, and least number of points.
DENSE, POINTS, LEAST_POINTS = 6.75, 4, 20_000
#: Distance of points on a triangle, and longest side of a triangle with one point, in spacings.
APART, SMALL = 0.7, 1.5
#: Squared distances along normals count 1 + FLAT times, so that layers with a gap of 2/3 spacings stay apart.
FLAT = 1.25
#: Number of samples below which no further level follows.
LEAST = 12
#: The number of parts of a sample is a multiple of this number, for loops over vectors of the processor.
GROUP = 4


class Means(NamedTuple):
    """Rows whose means the elements of a level take: rows ``row[start[i]:start[i + 1]]`` for element i."""

    start: np.ndarray
    row: np.ndarray
    weight: np.ndarray


class SurfaceSamples(NamedTuple):
    """Samples of all levels, and the points from which the first level was chosen.

    Attributes
    ----------
    spacing : float
        Of the first level; it doubles from level to level.
    levels : (l + 1, 2) int64
        Where samples and boxes of each level begin; at last, where they end.
    boxes : (b, 6) float64
        Trees of all levels; see :func:`sshade.carry.trees.box_tree`.
    begin : (s + 1,) int64
        Where the parts of each sample begin. Parts of the first level are points on triangles, and parts of
        each further level are samples of the level before.
    parts : (4, p) float64
        Coordinates and areas of the parts. The area is zero where a group is filled up.
    means : tuple of Means
        For each level, the rows of the level before. Rows of the first level are triangles.
    """

    spacing: float
    levels: np.ndarray
    boxes: np.ndarray
    begin: np.ndarray
    parts: np.ndarray
    means: tuple[Means, ...]


def sample_surface(corners: np.ndarray, areas: np.ndarray, normals: np.ndarray) -> SurfaceSamples:
    """Sample triangles with corners (t, 3, 3), areas (t,), all above 0, and unit normals (t, 3)."""
    order = np.argsort(areas)
    below = np.cumsum(areas[order])
    typical = areas[order[np.searchsorted(below, SMALLER * below[-1])]]
    most = max(POINTS * len(areas), LEAST_POINTS)
    spacing = h = max(SPACING * np.sqrt(typical), np.sqrt(DENSE * below[-1] / most))
    points, row = _points(corners, spacing)
    count = np.bincount(row, minlength=len(areas))
    last = _Set(points, points, (areas / count)[row], normals[row])
    means: list[Means] = []
    sizes, trees, begin, parts = [0], list[np.ndarray](), [np.zeros(1, dtype=np.int64)], list[np.ndarray]()
    while len(means) < 2 or len(last.points) >= LEAST:
        kept, parent = _thin(last.points, last.normals, h)
        order = curve_order(last.points[kept])
        kept, parent = kept[order], numbered(order, len(kept))[parent]
        area = np.bincount(parent, last.areas, len(kept))
        sequence = np.argsort(parent, kind="stable")
        start = np.searchsorted(parent[sequence], np.arange(len(kept) + 1))
        weight = (last.areas / area[parent])[sequence]
        means.append(Means(start, sequence if means else row[sequence], weight))
        low, high, end, of_level = _parts(last.centres, last.areas, parent, len(kept))
        sizes.append(len(kept))
        trees.append(box_tree(low, high, leaf=1))
        begin.append(begin[-1][-1] + end)
        parts.append(of_level)
        points, n = last.points[kept], last.normals[kept]
        total = np.stack([np.bincount(parent, last.areas * x, len(kept)) for x in last.centres.T], axis=1)
        centre = total / area[:, None]
        # A mean of places lies inside of a curved surface; it moves to the height of the sample's point.
        centre = centre + ((points - centre) * n).sum(axis=1, keepdims=True) * n
        last = _Set(points, centre, area, n)
        h *= 2
    return SurfaceSamples(
        float(spacing),
        np.stack([np.cumsum(sizes), np.cumsum([0, *map(len, trees)])], axis=1),
        np.concatenate(trees),
        np.concatenate(begin),
        np.concatenate(parts, axis=1),
        tuple(means),
    )


def _parts(
    places: np.ndarray, areas: np.ndarray, own: np.ndarray, samples: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Sort places by the sample that each belongs to, in groups filled up to :data:`GROUP` by zero areas.

    Returns the boxes of the groups (two arrays), where each ends, and coordinates and areas (4, p).
    """
    order = np.argsort(own, kind="stable")
    count = np.bincount(own, minlength=samples)
    start = np.cumsum(count) - count
    places, areas, own = places[order], areas[order], own[order]
    low, high = np.minimum.reduceat(places, start), np.maximum.reduceat(places, start)
    full = -(-count // GROUP) * GROUP
    end = np.cumsum(full)
    parts = np.zeros((4, end[-1]))
    parts[:3] = np.repeat(low, full, axis=0).T
    place = np.arange(len(own)) + (end - full - start)[own]
    parts[:3, place], parts[3, place] = places.T, areas
    return low, high, end, parts


class _Set(NamedTuple):
    points: np.ndarray
    centres: np.ndarray
    areas: np.ndarray
    normals: np.ndarray


def _points(corners: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Spread points (k, 3) over triangles, about a spacing apart; return the triangle (k,) of each, too."""
    sides = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2)
    first = np.argmax(sides, axis=1)
    turned = np.take_along_axis(corners, ((first[:, None] + np.arange(3)) % 3)[:, :, None], axis=1)
    a, u, v = turned[:, 0], turned[:, 1] - turned[:, 0], turned[:, 2] - turned[:, 0]
    longest = sides.max(axis=1)
    height = np.linalg.norm(np.cross(u, v), axis=1) / longest
    small = longest <= SMALL * spacing
    along, across = (
        np.where(small, 1, np.ceil(x / (APART * spacing))).astype(np.int64) for x in (longest, height)
    )
    count = along * across
    row = np.repeat(np.arange(len(corners)), count)
    number = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    s, t = (number % along[row] + 0.5) / along[row], (number // along[row] + 0.5) / across[row]
    outside = s + t > 1
    s, t = np.where(outside, 1 - s, s), np.where(outside, 1 - t, t)
    single = (count == 1)[row]
    s[single] = t[single] = 1 / 3
    return a[row] + s[:, None] * u[row] + t[:, None] * v[row], row


def _thin(points: np.ndarray, normals: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Return points (k,) that are a spacing apart, and the number in them of the nearest for each point."""
    size = 1 << int(np.ceil(np.log2(max(16, 2 * len(points)))))
    return _thinned(points, normals, points.min(axis=0), spacing, np.full(size, -1, dtype=np.int64))


@kernel
def _thinned(points, normals, low, spacing, head):
    after = np.full(len(points), -1, dtype=np.int64)  # chains of kept points with the same hash
    kept, parent = np.empty(len(points), dtype=np.int64), np.empty(len(points), dtype=np.int64)
    count = 0
    for i in range(len(points)):
        if _nearest_kept(i, points, normals, low, spacing, head, after, kept) < 0:
            place = _hash(points, i, low, spacing, 0, 0, 0, len(head))
            after[count], head[place] = head[place], count
            kept[count] = i
            count += 1
    for i in range(len(points)):
        parent[i] = _nearest_kept(i, points, normals, low, spacing, head, after, kept)
    return kept[:count].copy(), parent


@subroutine
def _hash(points, i, low, spacing, dx, dy, dz, size):
    x = np.int64((points[i, 0] - low[0]) / spacing) + dx
    y = np.int64((points[i, 1] - low[1]) / spacing) + dy
    z = np.int64((points[i, 2] - low[2]) / spacing) + dz
    return ((x * 73856093) ^ (y * 19349663) ^ (z * 83492791)) & (size - 1)


@subroutine
def _nearest_kept(i, points, normals, low, spacing, head, after, kept):
    """Return the number of the nearest kept point within the spacing and on the same side, or -1."""
    best, found = spacing * spacing, np.int64(-1)
    for dx in range(-1, 2):
        for dy in range(-1, 2):
            for dz in range(-1, 2):
                j = head[_hash(points, i, low, spacing, dx, dy, dz, len(head))]
                while j >= 0:
                    k = kept[j]
                    x, y, z = (
                        points[k, 0] - points[i, 0],
                        points[k, 1] - points[i, 1],
                        points[k, 2] - points[i, 2],
                    )
                    u, v = normals[i], normals[k]
                    side = u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
                    across = x * (u[0] + v[0]) + y * (u[1] + v[1]) + z * (u[2] + v[2])
                    d = x * x + y * y + z * z
                    if side > 0.0:
                        d += FLAT * across * across / (2.0 + 2.0 * side)
                    if (side > 0.0 or k == i) and d < best:
                        best, found = d, j
                    j = after[j]
    return found

"""Search trees over triangles and samples of a surface, and the weights of points near the surface.

A point at a distance d from the surface blends affine maps of the surface around it. Near the surface the
maps belong to triangles, farther away to samples. The spacing h of the samples grows with d, in levels by
factors of two (:mod:`sshade.carry.surface_samples`). Around the point lies a ball of the radius R = REACH d.
The weight of an element at the distance r from the point is

    (d / r)^2  times the integral of  (1 - |y - x|^2 / R^2)^2  over the element.

The integral over a triangle is exact. A sample has its area times the value of the
integrand; samples two levels finer than the elements stand for the elements. Weights of a level lose a small
portion of the largest one, and are divided by their sum. Two levels are blended over four fifths of an octave
of d. d, R and r are continuous functions of the point. Weights vanish at R, so all weights are continuous.
On the surface only the triangles at the point remain. Because R is a multiple of d, the blend between two
walls extends over a fixed portion of the gap between them. Because weights are integrals, it hardly depends
on the triangles.

If more than :data:`MOST` elements are within R, the distance of the next element replaces R. This distance is
continuous, too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sshade.kernels import kernel, subroutine

#: Items in a leaf of a tree.
LEAF = 4
#: Radius of the ball, in distances to the surface.
REACH = 3.0
#: Least distance to the surface in this radius, in spacings of the first level.
ON_SURFACE = 1e-7
#: Part of the weight of a triangle that does not depend on its area, so that a sliver alone has a weight.
SLIVER = 1e-9
#: Distance to the surface, over the spacing of the first level, at which only the first level counts.
FIRST = 0.5
#: Slope of the blend of two levels, per octave.
BLEND = 1.25
#: Weight that is subtracted from all weights of a level, as a fraction of the largest.
LEAST = 0.02
#: Largest number of elements of one level that a point blends.
MOST = 1000
#: Bits of a coordinate in the order of points along a space-filling curve.
BITS = 16


class Tree(NamedTuple):
    """A complete binary tree of boxes; items are in the order of a space-filling curve.

    Attributes
    ----------
    boxes : (2 p, 6) float64
        Lowest and highest corners of node i, whose children are 2 i and 2 i + 1. Node 1 is the root, and the
        last p nodes are leaves of :data:`LEAF` items.
    """

    boxes: np.ndarray

    @classmethod
    def of(cls, low: np.ndarray, high: np.ndarray) -> Tree:
        """Build the tree of items with lowest and highest corners (k, 3)."""
        leaves = 1 << max(0, int(np.ceil(np.log2(max(1, -(-len(low) // LEAF))))))
        boxes = np.empty((2 * leaves, 6))
        _build(low, high, leaves, boxes)
        return cls(boxes)


def curve_order(points: np.ndarray) -> np.ndarray:
    """Return the order (k,) int64 of points (k, 3) along a space-filling curve."""
    low, extent = points.min(axis=0), float(np.ptp(points, axis=0).max())
    scale = (1 << BITS) / (extent * (1 + 1e-9)) if extent else 0.0
    return np.argsort(_codes(points, low, scale), kind="stable")


@kernel
def _codes(points, low, scale):
    """Return the place of each point on the Morton curve."""
    codes = np.empty(len(points), dtype=np.int64)
    for i in range(len(points)):
        code = np.int64(0)
        for axis in range(3):
            x = np.int64((points[i, axis] - low[axis]) * scale)
            x = (x | (x << 32)) & 0x1F00000000FFFF
            x = (x | (x << 16)) & 0x1F0000FF0000FF
            x = (x | (x << 8)) & 0x100F00F00F00F00F
            x = (x | (x << 4)) & 0x10C30C30C30C30C3
            x = (x | (x << 2)) & 0x1249249249249249
            code |= x << axis
        codes[i] = code
    return codes


@kernel
def _build(low, high, leaves, boxes):
    for node in range(2 * leaves):
        for axis in range(3):
            boxes[node, axis], boxes[node, 3 + axis] = np.inf, -np.inf
    for item in range(len(low)):
        node = leaves + item // LEAF
        for axis in range(3):
            boxes[node, axis] = min(boxes[node, axis], low[item, axis])
            boxes[node, 3 + axis] = max(boxes[node, 3 + axis], high[item, axis])
    for node in range(leaves - 1, 0, -1):
        for axis in range(3):
            boxes[node, axis] = min(boxes[2 * node, axis], boxes[2 * node + 1, axis])
            boxes[node, 3 + axis] = max(boxes[2 * node, 3 + axis], boxes[2 * node + 1, 3 + axis])


@kernel(fastmath={"contract"}, error_model="numpy")
def squared_distances(first, end, X, corners, boxes, out):
    """Write the squared distances of points X (m, 3) from triangles, corners (t, 9) in the tree's order."""
    stack, far = np.empty(128, dtype=np.int64), np.empty(128)
    guess = np.int64(0)
    for i in range(first, end):
        out[i], guess = _nearest(X[i, 0], X[i, 1], X[i, 2], corners, boxes, guess, stack, far)


@kernel(fastmath={"contract"}, error_model="numpy")
def weigh(first, end, X, squared, corners, boxes, cell, spacing, levels, samples, areas, sample_boxes, owner):
    """Return the elements and weights of the points `first` to `end`.

    Parameters
    ----------
    X : (m, 3) float64
    squared : (m,) float64
        Squared distances from the surface.
    corners, boxes
        Corners (t, 9) of triangles, and their tree.
    cell : (t,) int64
        Element that stands for each triangle on the first level of samples.
    spacing : float
        Of the first level of samples.
    levels : (l + 1, 2) int64
        Where the samples and the boxes of each set begin; at last, where they end.
    samples, areas : (s, 3) and (s,) float64
        Samples of all sets, and their areas.
    sample_boxes : (b, 6) float64
        Boxes of all sets.
    owner : (s,) int64
        Element that stands for each sample two levels on.

    Returns
    -------
    count : (end - first,) int64
    element : (k,) int32
    weight : (k,) float64
    """
    count = np.empty(end - first, dtype=np.int64)
    element, weight = (
        np.empty(12 * (end - first) + 64, np.int32),
        np.empty(12 * (end - first) + 64),
    )
    stack, found, gap = np.empty(128, np.int64), np.empty(1024, np.int64), np.empty(1024)
    slot = np.full(len(corners) + len(samples), -1, dtype=np.int32)
    total, top, least_d = 0, len(levels), ON_SURFACE * spacing
    for i in range(first, end):
        x, y, z = X[i, 0], X[i, 1], X[i, 2]
        d = max(np.sqrt(squared[i]), least_d)
        level = min(max(np.log2(d / (FIRST * spacing)) + 1.0, 0.0), float(top))
        lower = np.int64(level)
        rise = min(max(BLEND * (level - lower - 0.5) + 0.5, 0.0), 1.0)
        rise = rise * rise * (3.0 - 2.0 * rise)
        begin = total
        for k in range(2):
            part, at = (1.0 - rise, lower) if k == 0 else (rise, lower + 1)
            if part == 0.0:
                continue
            radius, s = REACH * d, 0
            if at < 2:
                size, found, gap = _within(x, y, z, radius, corners, boxes, stack, found, gap)
            else:
                s, t = levels[at - 2, 0], levels[at - 1, 0]
                tree = sample_boxes[levels[at - 2, 1] : levels[at - 1, 1]]
                size, radius = 0, 0.5 * radius
                while size == 0:  # once, unless the samples leave a hole
                    radius *= 2.0
                    size, found, gap = _within(x, y, z, radius, samples[s:t], tree, stack, found, gap)
            if size > MOST:
                radius = np.sqrt(np.sort(gap[:size])[MOST]) + least_d
            while total + size > len(element):
                element, weight = _doubled(element), _doubled(weight)
            before, largest = total, 0.0
            for j in range(size):
                u = gap[j] / (radius * radius)
                if u >= 1.0:
                    continue
                w = (1.0 - u) * (1.0 - u)
                if at < 2:
                    w = SLIVER * w + _disc_integral(x, y, z, radius, corners, found[j])
                    own = cell[found[j]] if at == 1 else found[j]
                else:
                    w *= areas[s + found[j]] / (radius * radius)
                    own = owner[s + found[j]]
                w *= d * d / max(gap[j], d * d)
                if slot[own] < 0:
                    slot[own], element[total], weight[total] = total, own, 0.0
                    total += 1
                weight[slot[own]] += w
                largest = max(largest, weight[slot[own]])
            after, amount = before, 0.0
            for j in range(before, total):
                slot[element[j]] = -1
                w = weight[j] - LEAST * largest
                if w > 0.0:
                    element[after], weight[after] = element[j], w
                    amount += w
                    after += 1
            total = after
            for j in range(before, total):
                weight[j] *= part / amount
        count[i - first] = total - begin
    return count, element[:total].copy(), weight[:total].copy()


# Helpers are inlined, because each call would count references to the arrays.


@subroutine
def _doubled(values):
    new = np.empty(2 * len(values), values.dtype)
    new[: len(values)] = values
    return new


@subroutine(inline="always")
def _box_distance(x, y, z, boxes, node):
    dx, ex = boxes[node, 0] - x, x - boxes[node, 3]
    dy, ey = boxes[node, 1] - y, y - boxes[node, 4]
    dz, ez = boxes[node, 2] - z, z - boxes[node, 5]
    dx, dy, dz = dx if dx > ex else ex, dy if dy > ey else ey, dz if dz > ez else ez
    dx, dy, dz = dx if dx > 0.0 else 0.0, dy if dy > 0.0 else 0.0, dz if dz > 0.0 else 0.0
    return dx * dx + dy * dy + dz * dz


@subroutine(fastmath={"contract"}, error_model="numpy")
def _nearest(x, y, z, corners, boxes, guess, stack, far):
    """Return the least squared distance from a triangle, and the triangle; a near `guess` saves time."""
    best, item = _triangle_distance(x, y, z, corners, guess), guess
    leaves, size = len(boxes) // 2, 1
    stack[0], far[0] = 1, 0.0
    while size > 0:
        size -= 1
        node = stack[size]
        if far[size] >= best:
            continue
        while node < leaves:  # go down on the nearer side
            one, other = _box_distance(x, y, z, boxes, 2 * node), _box_distance(x, y, z, boxes, 2 * node + 1)
            node = 2 * node
            if one > other:
                node, one, other = node + 1, other, one
            if other < best:
                stack[size], far[size] = node + 1 if node % 2 == 0 else node - 1, other
                size += 1
            if one >= best:
                node = 0
                break
        if node > 0:
            begin = (node - leaves) * LEAF
            for j in range(begin, min(begin + LEAF, len(corners))):
                d = _triangle_distance(x, y, z, corners, j)
                if d < best:
                    best, item = d, j
    return best, item


@subroutine(fastmath={"contract"}, error_model="numpy")
def _within(x, y, z, radius, items, boxes, stack, found, gap):
    """Collect the triangles (k, 9) or points (k, 3) within a radius, with squared distances.

    Return their number and the arrays.
    """
    count, leaves, size, squared = 0, len(boxes) // 2, 1, radius * radius
    stack[0] = 1
    while size > 0:
        size -= 1
        node = stack[size]
        if node < leaves:
            for child in (2 * node, 2 * node + 1):
                if _box_distance(x, y, z, boxes, child) <= squared:
                    stack[size] = child
                    size += 1
            continue
        begin = (node - leaves) * LEAF
        if count + LEAF > len(found):
            found, gap = _doubled(found), _doubled(gap)
        for j in range(begin, min(begin + LEAF, len(items))):
            points = items.shape[1] == 3
            d = _point_distance(x, y, z, items, j) if points else _triangle_distance(x, y, z, items, j)
            if d <= squared:
                found[count], gap[count] = j, d
                count += 1
    return count, found, gap


@subroutine(inline="always")
def _point_distance(x, y, z, samples, j):
    dx, dy, dz = samples[j, 0] - x, samples[j, 1] - y, samples[j, 2] - z
    return dx * dx + dy * dy + dz * dz


@subroutine(inline="always")
def _triangle_distance(x, y, z, corners, j):
    """Return the squared distance from triangle j (C. Ericson, "Real-time collision detection", 5.1.5)."""
    ax, ay, az = x - corners[j, 0], y - corners[j, 1], z - corners[j, 2]
    ux, uy, uz = corners[j, 3] - corners[j, 0], corners[j, 4] - corners[j, 1], corners[j, 5] - corners[j, 2]
    vx, vy, vz = corners[j, 6] - corners[j, 0], corners[j, 7] - corners[j, 1], corners[j, 8] - corners[j, 2]
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    d1, d2 = ux * ax + uy * ay + uz * az, vx * ax + vy * ay + vz * az
    d3, d4, d5, d6 = d1 - uu, d2 - uv, d1 - uv, d2 - vv
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        s, t = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        s, t = 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:
        s, t = 0.0, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0 and d1 > d3:
        s, t = d1 / (d1 - d3), 0.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0 and d2 > d6:
        s, t = 0.0, d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0 and d4 - d3 + d5 - d6 > 0.0:
        t = (d4 - d3) / (d4 - d3 + d5 - d6)
        s = 1.0 - t
    elif va + vb + vc > 0.0:
        s, t = vb / (va + vb + vc), vc / (va + vb + vc)
    else:
        s, t = 0.0, 0.0
    ax, ay, az = ax - s * ux - t * vx, ay - s * uy - t * vy, az - s * uz - t * vz
    return ax * ax + ay * ay + az * az


@subroutine(fastmath={"contract"}, error_model="numpy")
def _disc_integral(x, y, z, radius, corners, j):
    """Integrate (1 - |y - x|^2 / R^2)^2 over the part of triangle j in the ball, in units of R^2.

    The ball cuts the plane in a disc around the foot of x. The integral over a triangle is the sum, with
    signs, of integrals over the triangles of the foot and a side.
    """
    c = corners[j]
    ux, uy, uz = c[3] - c[0], c[4] - c[1], c[5] - c[2]
    vx, vy, vz = c[6] - c[0], c[7] - c[1], c[8] - c[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    scale = 1.0 / np.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = scale * nx, scale * ny, scale * nz
    length = np.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux / length, uy / length, uz / length
    wx, wy, wz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    ax, ay, az = (c[0] - x) / radius, (c[1] - y) / radius, (c[2] - z) / radius
    height = ax * nx + ay * ny + az * nz
    squared = 1.0 - height * height
    if squared <= 0.0:
        return 0.0
    p, q = ax * ux + ay * uy + az * uz, ax * wx + ay * wy + az * wz
    side = (vx * ux + vy * uy + vz * uz) / radius, (vx * wx + vy * wy + vz * wz) / radius
    total = _side_integral(p, q, p + length / radius, q, squared)
    total += _side_integral(p + length / radius, q, p + side[0], q + side[1], squared)
    total += _side_integral(p + side[0], q + side[1], p, q, squared)
    return max(total, 0.0)


@subroutine(fastmath={"contract"}, error_model="numpy")
def _side_integral(px, py, qx, qy, s):
    """Integrate (s - r^2)^2, for r^2 < s, over the triangle of the origin, p and q; negative clockwise.

    In polar coordinates the integral over r is (s^3 - (s - r^2)^3) / 6. Along the side, at distance h from
    the origin, this is a polynomial in the place on the side. Outside of the disc it is constant.
    """
    dx, dy = qx - px, qy - py
    length = np.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return 0.0
    dx, dy = dx / length, dy / length
    h, a, b = px * dy - py * dx, px * dx + py * dy, qx * dx + qy * dy
    sign, h = 1.0 if h >= 0.0 else -1.0, abs(h)
    outside, inside, rest = 0.0, 0.0, s - h * h
    if rest <= 0.0:
        outside = np.arctan2(b, h) - np.arctan2(a, h)
    else:
        half = np.sqrt(rest)
        if a < -half:
            outside += np.arctan2(min(b, -half), h) - np.arctan2(a, h)
        if b > half:
            outside += np.arctan2(b, h) - np.arctan2(max(a, half), h)
        low, high = min(max(a, -half), half), min(max(b, -half), half)
        k = h * h
        one, three, five = high - low, (high**3 - low**3) / 3.0, (high**5 - low**5) / 5.0
        inside = h * ((3.0 * s * s - 3.0 * s * k + k * k) * one + (2.0 * k - 3.0 * s) * three + five)
    return sign * (inside + s * s * s * outside) / 6.0

"""Search trees over triangles and samples of a surface, and the weights of points near the surface.

A point at a distance d from the surface blends affine maps of the surface around it. Near the surface the
maps belong to triangles, farther away to samples. The spacing h of the samples grows with d, in levels by
factors of two (:mod:`sshade.carry.surface_samples`). Around the point lies a ball of the radius R = REACH d.
The weight of an element at the distance r from the point is

    (d / r)^2  times the integral of  (1 - |y - x|^2 / R^2)^2  over the element.

The integral over a triangle is exact. The integral over a sample is a sum over its parts, which are samples
of the level before, or points on triangles. Each part has its area times the value of the integrand, and its
own r. Weights of a level lose a small portion of the largest one, and are divided by their sum. Two levels
are blended over four fifths of an octave of d. d, R and r are continuous functions of the point. Weights
vanish at R, so all weights are continuous. On the surface only the triangles at the point remain. Because R
is a multiple of d, the blend between two walls extends over a fixed portion of the gap between them. Because
weights are integrals, it hardly depends on the triangles.

If more than :data:`MOST` triangles are within R, the distance of the next triangle replaces R. This distance
is continuous, too.
"""

from __future__ import annotations

import numpy as np

from sshade.kernels import kernel, subroutine
from sshade.mesh.mesh import bounds

#: Triangles in a leaf of their tree. A leaf of samples has one sample.
LEAF = 4
#: Radius of the ball, in distances to the surface.
REACH = 3.5
#: Least distance to the surface in this radius, in spacings of the first level.
ON_SURFACE = 1e-7
#: Part of the weight of a triangle that does not depend on its area, so that a sliver alone has a weight.
SLIVER = 1e-9
#: Distance to the surface, over the spacing of the first level, at which only the first level counts.
FIRST = 0.5
#: Slope of the blend of two levels, per octave.
BLEND = 1.25
#: Weight that is subtracted from all weights of a level, as a fraction of the largest.
LEAST = 0.015
#: Largest number of triangles that a point blends.
MOST = 1000
#: Most bits of a coordinate in the order of points along a space-filling curve.
BITS = 16


def box_tree(low: np.ndarray, high: np.ndarray, *, leaf: int) -> np.ndarray:
    """Build a complete binary tree of boxes around items in the order of a space-filling curve.

    Parameters
    ----------
    low, high : (k, 3) float64
        Lowest and highest corners of the items.
    leaf : int
        Number of items in each leaf.

    Returns
    -------
    (2 p, 6) float64
        Lowest and highest corners of node i, whose children are 2 i and 2 i + 1. Node 1 is the root, and the
        last p nodes are leaves.
    """
    leaves = 1 << (-(-len(low) // leaf) - 1).bit_length()
    boxes = np.empty((2 * leaves, 6))
    _build(low, high, leaf, boxes)
    return boxes


def curve_order(points: np.ndarray) -> np.ndarray:
    """Return the order (k,) int64 of points (k, 3) along a space-filling curve."""
    low, high = bounds(points)
    extent = float((high - low).max())
    shift = (len(points) - 1).bit_length()
    bits = min(BITS, (63 - shift) // 3)
    scale = (1 << bits) / (extent * (1 + 1e-9)) if extent else 0.0
    # Numbers of points fill the low bits, because NumPy sorts numbers faster than it finds their order.
    codes = np.sort((_codes(points, low, scale) << shift) | np.arange(len(points)))
    return codes & ((1 << shift) - 1)


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
def _build(low, high, leaf, boxes):
    leaves = len(boxes) // 2
    for node in range(2 * leaves):
        for axis in range(3):
            boxes[node, axis], boxes[node, 3 + axis] = np.inf, -np.inf
    for item in range(len(low)):
        node = leaves + item // leaf
        for axis in range(3):
            boxes[node, axis] = min(boxes[node, axis], low[item, axis])
            boxes[node, 3 + axis] = max(boxes[node, 3 + axis], high[item, axis])
    for node in range(leaves - 1, 0, -1):
        for axis in range(3):
            boxes[node, axis] = min(boxes[2 * node, axis], boxes[2 * node + 1, axis])
            boxes[node, 3 + axis] = max(boxes[2 * node, 3 + axis], boxes[2 * node + 1, 3 + axis])


def triangles_of_leaves(corners: np.ndarray) -> np.ndarray:
    """Return rows (l, 16, LEAF) of triangles with corners (t, 3, 3), for distances from a leaf.

    The rows are a corner, the sides u and v from there, u u, u v, v v, and the inverses of u u v v - (u v)^2
    and of the squared lengths of u, v and v - u. Inverses of zero are zero. Copies of the last triangle fill
    the last leaf.
    """
    corners = np.concatenate([corners, np.repeat(corners[-1:], -len(corners) % LEAF, axis=0)])
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    uu, uv, vv = (np.einsum("ij,ij->i", x, y) for x, y in ((u, u), (u, v), (v, v)))
    divisors = np.stack([uu * vv - uv * uv, uu, vv, ((v - u) ** 2).sum(axis=1)])
    inverses = np.divide(1.0, divisors, out=np.zeros_like(divisors), where=divisors > 0)
    rows = np.concatenate([a.T, u.T, v.T, [uu, uv, vv], inverses])
    return np.ascontiguousarray(rows.reshape(16, -1, LEAF).transpose(1, 0, 2))


@kernel(fastmath={"contract"}, error_model="numpy")
def squared_distances(first, end, X, triangles, boxes, out):
    """Write the squared distances of points X (m, 3) from :func:`triangles_of_leaves`."""
    stack, far, gap = np.empty(128, np.int64), np.empty(128), np.empty(LEAF)
    leaf = np.int64(0)
    for i in range(first, end):
        out[i], leaf = _nearest(X[i, 0], X[i, 1], X[i, 2], triangles, boxes, leaf, stack, far, gap)


@kernel(fastmath={"contract"}, error_model="numpy")
def weigh(first, end, X, squared, corners, triangles, boxes, spacing, levels, sample_boxes, begin, parts):
    """Return the elements and weights of the points `first` to `end`.

    Parameters
    ----------
    X : (m, 3) float64
    squared : (m,) float64
        Squared distances from the surface.
    corners, triangles, boxes
        Corners (t, 9) of triangles, :func:`triangles_of_leaves`, and their tree.
    spacing : float
        Of the first level of samples.
    levels : (l + 1, 2) int64
        Where the samples and the boxes of each level begin; at last, where they end.
    sample_boxes : (b, 6) float64
        Boxes of all levels.
    begin : (s + 1,) int64
        Where the parts of each sample begin.
    parts : (4, p) float64
        Coordinates and areas of the parts.

    Returns
    -------
    count : (end - first,) int64
    element : (k,) uint32
    weight : (k,) float32
    """
    count = np.empty(end - first, dtype=np.int64)
    element, weight = np.empty(16 * (end - first) + 64, np.uint32), np.empty(16 * (end - first) + 64)
    stack, leaf = np.empty(128, np.int64), np.empty(8, np.int64)
    gap = np.empty(LEAF)
    total, top, least_d = 0, len(levels) - 1, ON_SURFACE * spacing
    for i in range(first, end):
        x, y, z = X[i, 0], X[i, 1], X[i, 2]
        d = max(np.sqrt(squared[i]), least_d)
        level = min(max(np.log2(d / (FIRST * spacing)) + 1.0, 0.0), float(top))
        lower = np.int64(level)
        rise = min(max(BLEND * (level - lower - 0.5) + 0.5, 0.0), 1.0)
        rise = rise * rise * (3.0 - 2.0 * rise)
        began = total
        for k in range(2):
            part, at = (1.0 - rise, lower) if k == 0 else (rise, lower + 1)
            if part == 0.0:
                continue
            before, radius = total, REACH * d
            if at == 0:
                size, leaf = _leaves_within(x, y, z, radius, boxes, stack, leaf)
                total, element, weight = _weigh_triangles(
                    x, y, z, d, radius, least_d, leaf, size, triangles, corners, gap, total, element, weight
                )
            else:
                s = levels[at - 1, 0]
                tree = sample_boxes[levels[at - 1, 1] : levels[at, 1]]
                while total == before:  # once, unless the samples leave a hole
                    size, leaf = _leaves_within(x, y, z, radius, tree, stack, leaf)
                    total, element, weight = _weigh_samples(
                        x, y, z, d, radius, leaf, size, s, begin, parts, len(corners), total, element, weight
                    )
                    radius *= 2.0
            largest = 0.0
            for j in range(before, total):
                largest = max(largest, weight[j])
            after, amount = before, 0.0
            for j in range(before, total):
                w = weight[j] - LEAST * largest
                if w > 0.0:
                    element[after], weight[after] = element[j], w
                    amount += w
                    after += 1
            total = after
            for j in range(before, total):
                weight[j] *= part / amount
        count[i - first] = total - began
    return count, element[:total].copy(), weight[:total].astype(np.float32)


# Helpers are inlined, because each call would count references to the arrays.


@subroutine(fastmath={"contract"}, error_model="numpy")
def _weigh_triangles(
    x, y, z, d, radius, least_d, leaf, leaves, triangles, corners, gap, total, element, weight
):
    """Append the triangles in leaves, within a radius, with their weights."""
    while total + LEAF * leaves > len(element):
        element, weight = _doubled(element), _doubled(weight)
    end, squared = total, radius * radius
    for number in range(leaves):
        one = LEAF * leaf[number]
        _leaf_distances(x, y, z, triangles, leaf[number], gap)
        for k in range(min(LEAF, len(corners) - one)):
            if gap[k] <= squared:
                element[end], weight[end] = one + k, gap[k]
                end += 1
    if end - total > MOST:
        radius = np.sqrt(np.sort(weight[total:end])[MOST]) + least_d
    begin, inverse = total, 1.0 / (radius * radius)
    for j in range(begin, end):
        r = weight[j]
        u = 1.0 - r * inverse
        if u > 0.0:
            w = SLIVER * u * u + _disc_integral(x, y, z, radius, corners, element[j])
            element[total], weight[total] = element[j], w * d * d / max(r, d * d)
            total += 1
    return total, element, weight


@subroutine(fastmath={"contract", "reassoc", "nnan", "nsz"}, error_model="numpy")
def _weigh_samples(x, y, z, d, radius, leaf, leaves, s, begin, parts, triangles, total, element, weight):
    """Append samples of a level, which begins with sample s, within a radius, with their weights."""
    while total + leaves > len(element):
        element, weight = _doubled(element), _doubled(weight)
    inverse, closest = 1.0 / (radius * radius), d * d
    for number in range(leaves):
        sample, w = s + leaf[number], 0.0
        for j in range(np.uint64(begin[sample]), np.uint64(begin[sample + 1])):
            dx, dy, dz = parts[0, j] - x, parts[1, j] - y, parts[2, j] - z
            r = dx * dx + dy * dy + dz * dz
            u = 1.0 - r * inverse
            u = u if u > 0.0 else 0.0
            w += u * u * parts[3, j] / (r if r > closest else closest)
        if w > 0.0:
            element[total], weight[total] = triangles + sample, w
            total += 1
    return total, element, weight


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
def _nearest(x, y, z, triangles, boxes, leaf, stack, far, gap):
    """Return the least squared distance from a triangle, and the leaf of the triangle.

    The search begins at a leaf that is a guess, and goes on beside the way from there to the root.
    """
    leaves, size, level, best, item = len(boxes) // 2, 0, len(boxes) // 2, np.inf, leaf
    while level > 1:
        level //= 2
        stack[size] = ((leaves + leaf) // level) ^ 1
        far[size] = _box_distance(x, y, z, boxes, stack[size])
        size += 1
    stack[size], far[size] = leaves + leaf, 0.0
    size += 1
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
                stack[size], far[size] = node ^ 1, other
                size += 1
            if one >= best:
                node = 0
                break
        if node > 0:
            _leaf_distances(x, y, z, triangles, node - leaves, gap)
            for k in range(LEAF):
                if gap[k] < best:
                    best, item = gap[k], node - leaves
    return best, item


@subroutine(fastmath={"contract"}, error_model="numpy")
def _leaves_within(x, y, z, radius, boxes, stack, found):
    """Find the leaves of a tree within a radius; return their number, and the array of leaves."""
    count, leaves, size, squared = 0, len(boxes) // 2, 1, radius * radius
    stack[0] = 1
    while size > 0:
        size -= 1
        node = stack[size]
        if node >= leaves:
            if count == len(found):
                found = _doubled(found)
            found[count] = node - leaves
            count += 1
            continue
        for child in (2 * node, 2 * node + 1):
            if _box_distance(x, y, z, boxes, child) <= squared:
                stack[size] = child
                size += 1
    return count, found


@subroutine(fastmath={"contract", "nnan", "nsz"}, error_model="numpy")
def _leaf_distances(x, y, z, triangles, leaf, gap):
    """Write the squared distances from the triangles of a leaf.

    The nearest point of a triangle is on a side, or the foot of the point. A foot outside is moved into the
    triangle, where it is not nearer than the nearest point.
    """
    T = triangles[leaf]
    for k in range(LEAF):
        ax, ay, az = x - T[0, k], y - T[1, k], z - T[2, k]
        ux, uy, uz, vx, vy, vz = T[3, k], T[4, k], T[5, k], T[6, k], T[7, k], T[8, k]
        uu, uv, vv = T[9, k], T[10, k], T[11, k]
        au, av = ax * ux + ay * uy + az * uz, ax * vx + ay * vy + az * vz
        s = min(max(T[12, k] * (vv * au - uv * av), 0.0), 1.0)
        t = min(max(T[12, k] * (uu * av - uv * au), 0.0), 1.0 - s)
        dx, dy, dz = ax - s * ux - t * vx, ay - s * uy - t * vy, az - s * uz - t * vz
        best = dx * dx + dy * dy + dz * dz
        s = min(max(T[13, k] * au, 0.0), 1.0)
        dx, dy, dz = ax - s * ux, ay - s * uy, az - s * uz
        best = min(best, dx * dx + dy * dy + dz * dz)
        t = min(max(T[14, k] * av, 0.0), 1.0)
        dx, dy, dz = ax - t * vx, ay - t * vy, az - t * vz
        best = min(best, dx * dx + dy * dy + dz * dz)
        t = min(max(T[15, k] * (av - au - uv + uu), 0.0), 1.0)
        s = 1.0 - t
        dx, dy, dz = ax - s * ux - t * vx, ay - s * uy - t * vy, az - s * uz - t * vz
        gap[k] = min(best, dx * dx + dy * dy + dz * dz)


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
    a = ax * ux + ay * uy + az * uz, ax * wx + ay * wy + az * wz
    # Each corner for itself, because sums would round off the place of a point near the second or third one.
    ax, ay, az = (c[3] - x) / radius, (c[4] - y) / radius, (c[5] - z) / radius
    b = ax * ux + ay * uy + az * uz, ax * wx + ay * wy + az * wz
    ax, ay, az = (c[6] - x) / radius, (c[7] - y) / radius, (c[8] - z) / radius
    e = ax * ux + ay * uy + az * uz, ax * wx + ay * wy + az * wz
    total = _side_integral(a[0], a[1], b[0], b[1], squared)
    total += _side_integral(b[0], b[1], e[0], e[1], squared)
    total += _side_integral(e[0], e[1], a[0], a[1], squared)
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
    a, b = px * dx + py * dy, qx * dx + qy * dy
    h = px * dy - py * dx if abs(a) < abs(b) else qx * dy - qy * dx
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

"""The projection P of the vertices of a mesh M onto its proxy N.

P maps a vertex of M to the nearest point of the triangles around its sample. It takes O(n) in total, and a
vertex of an arm never lands on the torso that the arm touches.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sshade.core.kernels import kernel, subroutine
from sshade.core.threads import in_ranges
from sshade.mesh.incidence import sort_by_id
from sshade.mesh.mesh import Mesh
from sshade.proxy.sample import Sampling

#: Difference, as a fraction of the largest coordinate, below which two triangles are equally near.
TIE = 1e-14
#: Squared sine of the angle at a corner below which a triangle has no inside: its normal is rounding.
NEEDLE = 1e-16


@dataclass(frozen=True, eq=False)
class Projection:
    """Points of a proxy N, one for each vertex of M.

    Parameters
    ----------
    face : (n,) int64
        Triangle of N that contains the point.
    barycentric : (n, 3) float64
        Barycentric coordinates of the point in this triangle; they sum to one.
    """

    face: np.ndarray
    barycentric: np.ndarray


#: Projects the vertices of M (n, 3) onto N at rest; the third argument is the sampling that made N.
Projector = Callable[[np.ndarray, Mesh, Sampling], Projection]


def project_to_fans(V: np.ndarray, proxy: Mesh, sampling: Sampling) -> Projection:
    """Project each vertex of M to the nearest point of the triangles around its sample (the paper's P).

    If two triangles are equally near, as at samples and along ridges, the triangle with the nearer
    barycentre is taken. The result does not depend on the order of the triangles.

    Parameters
    ----------
    V : (n, 3) float64
        Vertices of M.
    proxy : Mesh
        N at rest.
    sampling : Sampling
        The sampling that made N; only `cell` is used.
    """
    start, corner = sort_by_id(proxy.F.ravel(), proxy.n)
    fan = corner // 3  # the faces at each vertex
    tie = TIE * float(np.abs(proxy.V).max())
    on = Projection(np.empty(len(V), dtype=np.int64), np.empty((len(V), 3)))
    rest = V, sampling.cell, start, fan, proxy.V, proxy.F, tie
    in_ranges(_project, len(V), *rest, on.face, on.barycentric)
    return on


@kernel
def _project(first, end, V, cell, start, fan, NV, NF, tie, face, barycentric):
    for i in range(first, end):
        x, s = _row(V, i), cell[i]
        best, best_v, best_w, best_face = np.inf, 0.0, 0.0, np.int64(-1)
        for p in range(start[s], start[s + 1]):
            t = fan[p]
            a, b, c = _row(NV, NF[t, 0]), _row(NV, NF[t, 1]), _row(NV, NF[t, 2])
            v, w, d = _closest_in_triangle(x, a, b, c)
            margin = 2.0 * np.sqrt(min(best, d)) * tie + tie * tie
            if d < best - margin:
                nearer = True
            elif d > best + margin:
                nearer = False
            else:
                u = best_face
                of_best = _row(NV, NF[u, 0]), _row(NV, NF[u, 1]), _row(NV, NF[u, 2])
                nearer = _to_barycentre(x, a, b, c) < _to_barycentre(x, *of_best)
            if nearer:
                best, best_v, best_w, best_face = d, v, w, t
        face[i] = best_face
        barycentric[i, 0], barycentric[i, 1], barycentric[i, 2] = 1.0 - best_v - best_w, best_v, best_w


@subroutine
def _closest_in_triangle(x, a, b, c):
    """Find the point of triangle (a, b, c) nearest to x: the weights of b and c, and the squared distance.

    C. Ericson, "Real-time collision detection", 2004, section 5.1.5.
    """
    ab, ac, ax = _minus(b, a), _minus(c, a), _minus(x, a)
    bx, cx = _minus(x, b), _minus(x, c)
    d1, d3, d5 = _dot(ab, ax), _dot(ab, bx), _dot(ab, cx)
    d2, d4, d6 = _dot(ac, ax), _dot(ac, bx), _dot(ac, cx)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        v, w = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        v, w = 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:
        v, w = 0.0, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0 and d1 > d3:
        v, w = d1 / (d1 - d3), 0.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0 and d2 > d6:
        v, w = 0.0, d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0 and (d4 - d3) + (d5 - d6) > 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1.0 - w
    else:
        # Ericson divides by va + vb + vc, which loses all digits on slivers. The normal loses half of them.
        normal = _cross(ab, ac)
        squared = _dot(normal, normal)
        v, w = _dot(normal, _cross(ax, ac)), _dot(normal, _cross(ab, ax))
        if v >= 0.0 and w >= 0.0 and v + w <= squared and squared > NEEDLE * _dot(ab, ab) * _dot(ac, ac):
            v, w = v / squared, w / squared
        else:  # take the nearest point of the edges
            on_ab, on_ac = _fraction(d1, d1 - d3), _fraction(d2, d2 - d6)
            on_bc = _fraction(d4 - d3, (d4 - d3) + (d5 - d6))
            least = np.inf
            for on_v, on_w in ((on_ab, 0.0), (0.0, on_ac), (1.0 - on_bc, on_bc)):
                distance = _squared_gap(ax, ab, ac, on_v, on_w)
                if distance < least:
                    least, v, w = distance, on_v, on_w
    return v, w, _squared_gap(ax, ab, ac, v, w)


@subroutine
def _squared_gap(ax, ab, ac, v, w):
    """|ax - v ab - w ac|^2."""
    dx = ax[0] - v * ab[0] - w * ac[0]
    dy = ax[1] - v * ab[1] - w * ac[1]
    dz = ax[2] - v * ab[2] - w * ac[2]
    return dx * dx + dy * dy + dz * dz


@subroutine
def _fraction(part, whole):
    return min(max(part / whole, 0.0), 1.0) if whole > 0.0 else 0.0


@subroutine
def _to_barycentre(x, a, b, c):
    """Return the squared distance from x to the barycentre of triangle (a, b, c)."""
    middle = (a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0, (a[2] + b[2] + c[2]) / 3.0
    gap = _minus(middle, x)
    return _dot(gap, gap)


@subroutine
def _row(A, i):
    return A[i, 0], A[i, 1], A[i, 2]


@subroutine
def _minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@subroutine
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@subroutine
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]

"""The projection P: where each vertex of M lies on the proxy N.

P takes a vertex of M to the nearest point of the triangle fan around its own sample: O(n) in
all, and a vertex of an arm never lands on the torso that the arm touches.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from sshade.mesh.adjacency import faces_around_vertices
from sshade.mesh.mesh import Mesh
from sshade.sampling.remesh import Remesh

#: Distances closer than this, times the largest coordinate, count as equal when triangles compete.
TIE = 1e-14


@dataclass(frozen=True, eq=False)
class Projection:
    """The nearest points of some vertices on a proxy.

    Parameters
    ----------
    face : (n,) int64
        Triangle of N.
    barycentric : (n, 3) float64
        Coordinates of the nearest point in it; they sum to one.
    distance : (n,) float64
        Euclidean distance to that point.
    """

    face: np.ndarray
    barycentric: np.ndarray
    distance: np.ndarray


#: Takes the vertices of M (n, 3), N at rest, and how N was sampled.
Projector = Callable[[np.ndarray, Mesh, Remesh], Projection]


def project_to_fans(V: np.ndarray, proxy: Mesh, remeshed: Remesh) -> Projection:
    """P: the nearest point of the triangles of N at the vertex's own sample.

    Where two triangles are equally near, as at samples and along ridges, the
    one whose barycentre is nearer is taken, whatever their numbers.

    Parameters
    ----------
    V : (n, 3) float64
        Vertices of M.
    proxy : Mesh
        N; each of its vertices has a triangle.
    remeshed : Remesh
        Its `region` tells the sample of each vertex of M.
    """
    start, fan = faces_around_vertices(proxy.F, proxy.n)
    tie = TIE * float(np.abs(proxy.V).max())
    return Projection(*_project(V, remeshed.region, start, fan, proxy.V, proxy.F, tie))


@njit(cache=True, nogil=True)
def _closest_in_triangle(px, py, pz, V, a, b, c):
    """Barycentric coordinates of the point of triangle (a, b, c) nearest to p, and the squared distance.

    C. Ericson, "Real-time collision detection", 2004, section 5.1.5.
    """
    abx, aby, abz = V[b, 0] - V[a, 0], V[b, 1] - V[a, 1], V[b, 2] - V[a, 2]
    acx, acy, acz = V[c, 0] - V[a, 0], V[c, 1] - V[a, 1], V[c, 2] - V[a, 2]
    apx, apy, apz = px - V[a, 0], py - V[a, 1], pz - V[a, 2]
    bpx, bpy, bpz = px - V[b, 0], py - V[b, 1], pz - V[b, 2]
    cpx, cpy, cpz = px - V[c, 0], py - V[c, 1], pz - V[c, 2]
    d1 = abx * apx + aby * apy + abz * apz
    d2 = acx * apx + acy * apy + acz * apz
    d3 = abx * bpx + aby * bpy + abz * bpz
    d4 = acx * bpx + acy * bpy + acz * bpz
    d5 = abx * cpx + aby * cpy + abz * cpz
    d6 = acx * cpx + acy * cpy + acz * cpz
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
        # Ericson divides by va + vb + vc, which loses all digits on slivers; the normal loses half.
        nx, ny, nz = aby * acz - abz * acy, abz * acx - abx * acz, abx * acy - aby * acx
        squared = nx * nx + ny * ny + nz * nz
        v = nx * (apy * acz - apz * acy) + ny * (apz * acx - apx * acz) + nz * (apx * acy - apy * acx)
        w = nx * (aby * apz - abz * apy) + ny * (abz * apx - abx * apz) + nz * (abx * apy - aby * apx)
        if v >= 0.0 and w >= 0.0 and v + w <= squared and squared > 0.0:
            v, w = v / squared, w / squared
        else:  # what looks like the inside of a triangle without area
            v, w = _closest_on_edges(d1, d2, d3, d4, d5, d6, apx, apy, apz, abx, aby, abz, acx, acy, acz)
    dx = apx - v * abx - w * acx
    dy = apy - v * aby - w * acy
    dz = apz - v * abz - w * acz
    return v, w, dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True)
def _share(part, whole):
    return min(max(part / whole, 0.0), 1.0) if whole > 0.0 else 0.0


@njit(cache=True, nogil=True)
def _closest_on_edges(d1, d2, d3, d4, d5, d6, apx, apy, apz, abx, aby, abz, acx, acy, acz):
    """Barycentric coordinates of the nearest point of the three edges, of any length."""
    on_ab, on_ac = _share(d1, d1 - d3), _share(d2, d2 - d6)
    on_bc = _share(d4 - d3, (d4 - d3) + (d5 - d6))
    best, best_v, best_w = np.inf, 0.0, 0.0
    for v, w in ((on_ab, 0.0), (0.0, on_ac), (1.0 - on_bc, on_bc)):
        dx = apx - v * abx - w * acx
        dy = apy - v * aby - w * acy
        dz = apz - v * abz - w * acz
        squared = dx * dx + dy * dy + dz * dz
        if squared < best:
            best, best_v, best_w = squared, v, w
    return best_v, best_w


@njit(cache=True, nogil=True)
def _squared_to_barycentre(px, py, pz, V, a, b, c):
    dx = (V[a, 0] + V[b, 0] + V[c, 0]) / 3.0 - px
    dy = (V[a, 1] + V[b, 1] + V[c, 1]) / 3.0 - py
    dz = (V[a, 2] + V[b, 2] + V[c, 2]) / 3.0 - pz
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True)
def _project(V, region, start, fan, NV, NF, tie):
    n = V.shape[0]
    face = np.empty(n, dtype=np.int64)
    barycentric = np.empty((n, 3), dtype=np.float64)
    distance = np.empty(n, dtype=np.float64)
    for i in range(n):
        px, py, pz = V[i, 0], V[i, 1], V[i, 2]
        s = region[i]
        best, best_v, best_w, best_face = np.inf, 0.0, 0.0, np.int64(-1)
        for p in range(start[s], start[s + 1]):
            t = fan[p]
            a, b, c = NF[t, 0], NF[t, 1], NF[t, 2]
            v, w, d = _closest_in_triangle(px, py, pz, NV, a, b, c)
            margin = 2.0 * np.sqrt(min(best, d)) * tie + tie * tie
            if d < best - margin:
                nearer = True
            elif d > best + margin:
                nearer = False
            else:
                nearer = _squared_to_barycentre(px, py, pz, NV, a, b, c) < _squared_to_barycentre(
                    px, py, pz, NV, NF[best_face, 0], NF[best_face, 1], NF[best_face, 2]
                )
            if nearer:
                best, best_v, best_w, best_face = d, v, w, t
        face[i] = best_face
        barycentric[i, 0], barycentric[i, 1], barycentric[i, 2] = 1.0 - best_v - best_w, best_v, best_w
        distance[i] = np.sqrt(best)
    return face, barycentric, distance

"""Implicit-ARAP without torch: its edge weights in loops, and its normalisation of meshes."""

import numpy as np
import pytest
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from baselines.implicit_arap.patch_edges import weighted_edges


def cotangent(P, at, b, c):
    u, v = P[b] - P[at], P[c] - P[at]
    return u @ v / np.linalg.norm(np.cross(u, v))


def planar_patch(points=30, seed=3):
    """Points in space, their middle first, with Delaunay triangles of their x and y."""
    rng = np.random.default_rng(seed)
    P = np.concatenate([np.zeros((1, 3)), rng.normal(size=(points - 1, 3))])
    return P, Delaunay(P[:, :2]).simplices.astype(np.int64)


def energy_of(P, triangles, weights, R, images):
    """The energy of a patch by :func:`weighted_edges`."""
    edges, corners = weighted_edges(triangles, weights)
    cotangents = [cotangent(P, *np.roll(t, -k)) for k in range(3) for t in triangles]
    a, b = edges.T
    stretch = np.einsum("eij,ej->ei", R[a], P[a] - P[b]) - (images[a] - images[b])
    return (np.array(cotangents) @ corners * np.square(stretch).sum(axis=1)).sum()


def of_the_authors(P, triangles, R, images):
    """The energy of a patch in loops, as the authors' code computes it: blocks of edges, later ones win."""
    ends = ((0, 1, 0), (1, 2, 1), (0, 2, 2))  # first end, second end, corner whose cotangent is taken
    listed, half = [], {}
    for first, second, corner in ends:
        for t in triangles:
            half[t[first], t[second]] = cotangent(P, *np.roll(t, -corner))
            listed.append((t[first], t[second]))
    total = 0.0
    for a, b in listed:
        stretch = R[a] @ (P[a] - P[b]) - (images[a] - images[b])
        total += (half.get((a, b), 0.0) + half.get((b, a), 0.0)) * stretch @ stretch
    return total


def of_the_paper(P, triangles, R, images):
    """The energy of a patch in loops, with the cotangents opposite each edge, in both directions."""
    total = 0.0
    for t in triangles:
        for c, a, b in (np.roll(t, -k) for k in range(3)):
            for i, j in ((a, b), (b, a)):
                stretch = R[i] @ (P[i] - P[j]) - (images[i] - images[j])
                total += cotangent(P, c, a, b) * stretch @ stretch
    return total


@pytest.mark.parametrize(("weights", "literal"), [("authors", of_the_authors), ("cotangents", of_the_paper)])
def test_the_energy_of_a_patch_is_that_of_the_loops(weights, literal):
    P, triangles = planar_patch()
    rng = np.random.default_rng(4)
    R, images = Rotation.random(len(P), rng=rng).as_matrix(), rng.normal(size=P.shape)
    found = energy_of(P, triangles, weights, R, images)
    assert found == pytest.approx(literal(P, triangles, R, images), rel=1e-12)

"""Biharmonic deformation with numpy and scipy alone: one sparse linear solve.

    python biharmonic.py mesh.off handles.txt output.npy

It reads an OFF file and lines "vertex x y z", and writes the deformed positions. It knows nothing of sshade.
"""

import json
import sys
import time

import numpy as np
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import splu


def read_off(path):
    """Return the vertices and triangles of an OFF file."""
    n, m, _ = np.loadtxt(path, skiprows=1, max_rows=1, dtype=int)
    V = np.loadtxt(path, skiprows=2, max_rows=n)
    F = np.loadtxt(path, skiprows=2 + n, max_rows=m, dtype=int)
    return V, F[:, 1:]


def bilaplacian(V, F):
    """Return L M^-1 L of the cotangent Laplacian L and the vertex areas M."""
    n, rows, columns, weights = len(V), [], [], []
    for corner in range(3):
        i, j, k = F[:, (corner + 1) % 3], F[:, (corner + 2) % 3], F[:, corner]
        a, b = V[i] - V[k], V[j] - V[k]
        cross = np.linalg.norm(np.cross(a, b), axis=1)
        rows, columns = [*rows, i, j], [*columns, j, i]
        weights += 2 * [(a * b).sum(axis=1) / (2 * np.maximum(cross, 1e-12))]
    place = np.concatenate(rows), np.concatenate(columns)
    W = coo_array((np.concatenate(weights), place), shape=(n, n)).tocsr()
    L = diags_array(W.sum(axis=1)) - W
    area = np.bincount(F.ravel(), np.repeat(cross, 3), minlength=n) / 6
    return (L @ diags_array(1 / area) @ L).tocsc()


def deform(V, F, index, target):
    """Return the deformed positions: rest shape and a smooth displacement."""
    Q = bilaplacian(V, F)
    free = np.setdiff1d(np.arange(len(V)), index)
    P = V.copy()
    P[index] = target
    P[free] -= splu(Q[free][:, free]).solve(Q[free][:, index] @ (target - V[index]))
    return P


def main(mesh, handles, output):
    """Read the files, deform, and write the result."""
    V, F = read_off(mesh)
    rows = np.loadtxt(handles, ndmin=2)
    begin = time.perf_counter()
    P = deform(V, F, rows[:, 0].astype(int), rows[:, 1:])
    seconds = time.perf_counter() - begin
    np.save(output, P)
    with open(f"{output}.json", "w") as file:  # optional
        json.dump({"seconds": seconds, "iterations": 1}, file)


if __name__ == "__main__":
    main(*sys.argv[1:])

"""Pack the assets of the scans: ``python -m tools.bake.scans --meshes DIR --out DIR``.

The folder of the meshes holds koala.ply, cat.ply and hand.ply from https://github.com/odedstein/meshes.
NOTICE names their authors. The assets are committed; run this only to change them.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.sparse.csgraph import reverse_cuthill_mckee

from defaust.sources.scans import SHIPPED, STEPS
from sshade import Mesh
from sshade.io.meshes import read_mesh
from sshade.mesh.adjacency import edge_graph
from tools.bake import bake_command, write_asset

#: Size of a stored difference, in bytes.
BYTES = 3


def pack(mesh: Mesh) -> dict[str, np.ndarray]:
    """Encode a mesh of less than 4 million vertices in arrays that compress well.

    Positions are rounded to a cubic lattice; no coordinate moves by more than half a lattice step. Vertices
    are numbered in reverse Cuthill-McKee order, and faces are sorted.

    Returns
    -------
    dict
        See :func:`defaust.sources.scans.unpack`.
    """
    corner = mesh.V.min(axis=0)
    step = (mesh.V.max(axis=0) - corner).max() / STEPS
    order = reverse_cuthill_mckee(edge_graph(mesh).matrix.tocsr(), symmetric_mode=True)
    number = np.empty(mesh.n, dtype=np.int64)
    number[order] = np.arange(mesh.n)
    lattice = np.round((mesh.V[order] - corner) / step).astype(np.int64)
    F = number[mesh.F]
    F = np.take_along_axis(F, (F.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1)
    F = F[np.lexsort(F.T[::-1])]
    F = np.diff(F, axis=1, prepend=0)
    F[:, 0] = np.diff(F[:, 0], prepend=0)
    return {
        "corner": corner,
        "step": np.float64(step),
        "vertices": _planes(np.diff(lattice, axis=0, prepend=0)),
        "faces": _planes(F),
    }


def _planes(integers: np.ndarray) -> np.ndarray:
    """Split signed integers (k, 3) into their bytes (BYTES, k, 3) uint8; small integers need one byte."""
    unsigned = np.where(integers < 0, -2 * integers - 1, 2 * integers)
    return np.stack([(unsigned >> 8 * k & 0xFF).astype(np.uint8) for k in range(BYTES)])


def bake(args: argparse.Namespace) -> None:
    """Pack each scan and write its asset."""
    for name in SHIPPED:
        write_asset(args.out / f"{name}.npz", pack(read_mesh(args.meshes / f"{name}.ply")))


def main(argv: list[str] | None = None) -> int:
    """Parse the command line, and write the assets."""
    parser = argparse.ArgumentParser(prog="python -m tools.bake.scans", description=__doc__)
    parser.add_argument("--meshes", type=Path, required=True, help="folder of the meshes")
    return bake_command(parser, bake, argv, out="folder of the .npz files to write")


if __name__ == "__main__":
    sys.exit(main())

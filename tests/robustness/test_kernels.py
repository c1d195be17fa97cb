"""Kernels give the same results as machine code and as plain Python, which checks every index.

The functions of `WORK` call kernels on tiny meshes. Without its compiler, Numba runs them as plain Python.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from scipy.sparse import csr_array

from baselines.ablations.named_frames import named_frames
from baselines.accelerated import local_global
from baselines.arap_sr.arap_sr import arap_sr
from baselines.deformation_graph.deformation_graph import deformation_graph
from sshade import DeformationTask, bind, deform, transfer_pose
from sshade.core.threads import ThreadTeam
from sshade.files.meshes import read_file, write_file
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.cutting import cut_to_manifold
from sshade.proxy.coarse import sample_coarsely
from sshade.proxy.sample import sample_proxy
from sshade.solver.multigrid import ConjugateGradients, Multigrid
from tests.shapes import bent, bumpy, double_torus, held_ends, icosphere, jittered, moved_parts, torus
from tests.sshade.mesh.test_cutting import moebius, t_fin
from tests.write import off

#: Maximum difference, relative to the largest value. The compiler contracts and reorders sums.
CLOSE = 1e-9
BODY = bumpy(2)
FEW: dict[str, Any] = {"tolerance": 0.0, "max_iterations": 4}


#: A body of 162 vertices with one end fixed and the other end moved: a few handles, and whole regions.
TASK, REGIONS = held_ends(BODY, share=0.1), held_ends(BODY, share=0.35)
#: Twelve handles of one vertex, of which one moves.
ALONE = moved_parts(BODY.V, *(([vertex], 0.2 * (vertex > 150)) for vertex in range(0, BODY.n, 14)))


def _deformed(task: DeformationTask = TASK, **options: Any) -> np.ndarray:
    return deform(task, vertices=50, **FEW, **options).vertices


def _bound() -> np.ndarray:
    binding = bind(BODY, 40, frames=named_frames("blended_affine"))
    return binding.carry(bent(binding.proxy.V))[0]


def _remeshed() -> np.ndarray:
    """Sample a proxy with few vertices. Cells fail the closed-ball test, which then adds samples."""
    found = sample_proxy(double_torus(cells=2), 4, seed=1)
    return np.concatenate([found.samples, found.faces.ravel(), found.cell])


def _sampled_coarsely() -> np.ndarray:
    mesh = jittered(torus(24, 12), 0.05)
    found = sample_coarsely(mesh, vertex_graph(mesh), 20, first=np.array([5, 6]))
    return np.concatenate([found.samples, found.cell, found.distance])


def _cut() -> np.ndarray:
    return np.concatenate([cut_to_manifold(mesh).mesh.F.ravel() for mesh in (t_fin(), moebius())])


def _written() -> np.ndarray:
    """Read a text file with normals, bend the mesh, write it, and return the written numbers."""
    body = icosphere(1)
    with TemporaryDirectory() as folder:
        path = Path(folder, "a.off")
        path.write_bytes(off(np.column_stack([body.V, body.V]), body.F, keyword="NOFF"))
        file = read_file(path)
        write_file(path, file, bent(file.V))
        return np.array(path.read_text().split()[1:], dtype=np.float64)


def _cycled() -> np.ndarray:
    """Run one multigrid cycle on two levels, then conjugate gradients with cycles.

    One row of the matrix is fixed, and one row has no strong neighbours.
    """
    rng = np.random.default_rng(0)
    A = csr_array(np.diag(np.full(29, -1.0), 1) + np.diag(np.full(29, -1.0), -1) + np.diag(np.full(30, 2.1)))
    A[[0, 1], [1, 0]] = -1e-3
    held = np.arange(30) == 20
    B, X, Y = np.where(held[:, None], 0.0, rng.normal(size=(30, 3))), *np.empty((2, 30, 3))
    with patch("sshade.solver.multigrid.COARSEST", 5), ThreadTeam(1) as team:
        multigrid = Multigrid(A, held)
        multigrid.apply(B, X, team=team)
        Y[:] = X
        ConjugateGradients(multigrid, np.flatnonzero(held), steps=1).refine(B, Y, 1e-3, team)
    return np.concatenate([X, Y])


WORK: dict[str, Callable[[], np.ndarray]] = {
    "fast": _deformed,
    "fine": partial(_deformed, method="fine", polish_iterations=3, workers=1),
    "accelerated arap sr": lambda: arap_sr(TASK, accelerate=True, **FEW).vertices,
    "bending": lambda: local_global(TASK, bending=0.1, stiffness=0.1, **FEW).vertices,
    "single points": partial(_deformed, DeformationTask("alone", BODY, ALONE)),
    "deformation graph": lambda: deformation_graph(TASK, nodes=40, **FEW).vertices,
    "blended affine frames": _bound,
    "reconstruction": lambda: transfer_pose(BODY, bent(BODY.V), vertices=50, samplings=1).vertices,
    "regions": partial(_deformed, REGIONS),
    "interpolate": lambda: deform(REGIONS, method="interpolate").vertices,
    "sampling from coarse to fine": _sampled_coarsely,
    "cutting": _cut,
    "remeshing with few samples": _remeshed,
    "files": _written,
    "multigrid cycles": _cycled,
}


@pytest.mark.full
def test_kernels_give_uncompiled_what_they_give_compiled(tmp_path):
    command = [sys.executable, "-m", __name__, str(tmp_path / "plain.npz")]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "plain.npz") as plain:
        for name, work in WORK.items():
            found = work()
            atol = CLOSE * np.abs(found).max()
            np.testing.assert_allclose(plain[name], found, rtol=0, atol=atol, err_msg=name)


if __name__ == "__main__":
    np.savez(sys.argv[1], **{name: work() for name, work in WORK.items()})

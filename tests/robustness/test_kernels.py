"""Kernels give the same results as machine code and as plain Python, which checks every index.

The functions of `WORK` together call every kernel on tiny meshes, first compiled and then as plain Python.
"""

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from numba.core.registry import CPUDispatcher
from scipy.sparse import csr_array

from baselines.accelerated import local_global
from baselines.arap_sr.arap_sr import arap_sr
from baselines.deformation_graph.deformation_graph import deformation_graph
from sshade import DeformationTask, bind, deform, transfer_pose
from sshade.core.threads import ThreadTeam
from sshade.files.meshes import read_file, write_file
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.cutting import cut_to_manifold
from sshade.proxy.coarse import sample_coarsely
from sshade.proxy.projection import _closest_in_triangle
from sshade.proxy.sample import sample_proxy
from sshade.solver.multigrid import ConjugateGradients, Multigrid
from tests.shapes import bent, bumpy, double_torus, held_ends, icosphere, jittered, moved_parts, torus
from tests.sshade.mesh.test_cutting import moebius, t_fin
from tests.test_kernels import modules_with_kernels
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
    binding = bind(BODY, 40, frames="blended_affine")
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


def _on_needles() -> np.ndarray:
    """Find closest points in triangles whose corners lie on a line up to rounding."""
    rng = np.random.default_rng(0)
    found = []
    for _ in range(200):
        begin, way = rng.normal(size=(2, 3))
        V = begin + np.array([0.0, rng.uniform(0.1, 1), rng.uniform(0.1, 2)])[:, None] * way
        x = begin + 0.5 * way + 1e-16 * rng.normal(size=3)
        found.append(_closest_in_triangle(tuple(x), *map(tuple, V)))
    return np.array(found)


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
    multigrid = Multigrid(A, held, coarsest=5)
    with ThreadTeam(1) as team:
        multigrid.apply(B, X, team=team)
        Y[:] = X
        ConjugateGradients(multigrid, np.flatnonzero(held), steps=1).refine(B, Y, 1e-3, team)
    return np.concatenate([X, Y])


WORK: dict[str, Callable[[], np.ndarray]] = {
    "fast": _deformed,
    "fine": partial(_deformed, method="fine", polish_iterations=3, workers=1),
    "accelerated arap sr": lambda: arap_sr(TASK, accelerate=True, **FEW).vertices,
    "bending": lambda: local_global(TASK, bending=0.1, stiffness=0.1, **FEW).vertices,
    "inertia": partial(_deformed, DeformationTask("alone", BODY, ALONE), inertia=0.2),
    "deformation graph": lambda: deformation_graph(TASK, nodes=40, **FEW).vertices,
    "blended affine frames": _bound,
    "reconstruction": lambda: transfer_pose(BODY, bent(BODY.V), vertices=50, samplings=1).vertices,
    "regions": partial(_deformed, REGIONS),
    "interpolate": lambda: deform(REGIONS, method="interpolate").vertices,
    "sampling from coarse to fine": _sampled_coarsely,
    "cutting": _cut,
    "remeshing with few samples": _remeshed,
    "points near needles": _on_needles,
    "files": _written,
    "multigrid cycles": _cycled,
}


def kernels() -> dict[CPUDispatcher, list[tuple[Any, str]]]:
    """Return every compiled function, with the modules and the names that refer to it."""
    modules_with_kernels()  # are imported
    found: dict[CPUDispatcher, list[tuple[Any, str]]] = {}
    for module in [
        m for n, m in sys.modules.items() if n.startswith(("sshade.", "baselines.", "eval.", __name__))
    ]:
        for name, value in vars(module).items():
            if isinstance(value, CPUDispatcher):
                found.setdefault(value, []).append((module, name))
    return found


# Machine code divides by zero without a warning.
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_every_kernel_gives_uncompiled_what_it_gives_compiled(monkeypatch):
    expected = {name: work() for name, work in WORK.items()}
    called = set()

    def plain(kernel: CPUDispatcher) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            called.add(kernel)
            return kernel.py_func(*arguments)

        return call

    compiled = kernels()
    assert len(compiled) > 60
    for kernel, places in compiled.items():
        for module, name in places:
            monkeypatch.setattr(module, name, plain(kernel))
    for name, work in WORK.items():
        np.testing.assert_allclose(
            work(), expected[name], rtol=0, atol=CLOSE * np.abs(expected[name]).max(), err_msg=name
        )
    missed = [f"{kernel.__module__}.{kernel.__name__}" for kernel in compiled if kernel not in called]
    assert missed == [], "WORK needs something that calls them"

"""Deformations: methods, options, handles and surfaces of all kinds."""

import sys
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import trimesh
from scipy.spatial import cKDTree

import sshade
from baselines.arap import arap as arap
from sshade import DeformationResult, DeformationTask, Deformer, Handles, Mesh, deform
from sshade.cli.main import main
from sshade.core import threads
from sshade.core.threads import ThreadTeam
from sshade.files.meshes import read_mesh, write_mesh
from sshade.files.task_files import write_handles
from sshade.mesh.adjacency import vertex_graph
from sshade.mesh.boxes import opposite_vertices
from sshade.problem.options import Options as Options
from sshade.problem.options import Stop as Stop
from sshade.proxy.along import moved_with_distance as moved_with_distance
from sshade.proxy.fronts import Fronts, farthest_point_sampling
from sshade.regions.handle_regions import are_dense as are_dense
from sshade.regions.handle_regions import has_regions as has_regions
from tests.record.scenes.scene import BODY, LIMB, Values, outcomes, patches, scene, solved
from tests.shapes import bent, beside, bumpy, end_handles, rotation, shifted, strip, torn, unjoined
from tests.shapes import torus as torus
from tests.shapes import tube as tube
from tests.sshade.mesh.test_cutting import moebius, t_fin

#: What the calls of the table use.
SMALL = bumpy(2)
ENDS = end_handles(SMALL.V, count=8, shift=[0.3, 0, 0.2])
B, BC = ENDS.index, ENDS.target
TASK = DeformationTask("body", SMALL, ENDS)
TURN = rotation(4)
PAIR = beside(SMALL, shifted(SMALL, [9, 0, 0]))
SPLIT = trimesh.Trimesh(*torn(SMALL)[:2], process=False)
SOUP = trimesh.Trimesh(unjoined(SMALL).V, unjoined(SMALL).F, process=False)
TOUCHING = beside(SMALL, shifted(SMALL, SMALL.V[B[-1]] - SMALL.V[B[0]]))
NEARER = beside(SMALL, Mesh(SMALL.V[[10, 50, 90]], [[0, 1, 2]]))

#: Sizes from which on threads share work.
SHARED_FROM = "core.threads.CHUNK", "core.threads.ROWS", "method.piece.LARGE", "solver.laplacian.HALF"
SHARED_FROM += ("solver.factorisation.SHARED",)


def halfway(task: DeformationTask, seed: int = 0, **_: Any) -> DeformationResult:
    """A method of a user, which moves handles by half their way, and has a seed."""
    V = task.mesh.V.copy()
    V[task.handles.index] += 0.5 * (task.handles.target - V[task.handles.index])
    return DeformationResult(V, iterations=3 + seed, converged=None)


def all_over(share: float, target: np.ndarray) -> DeformationTask:
    """A task whose handles are random vertices."""
    index = np.random.default_rng(3).permutation(SMALL.n)[: int(share * SMALL.n)]
    return DeformationTask("all over", SMALL, Handles(index, target[index]))


def sampled(count: int, first: list[int]) -> Fronts:
    return farthest_point_sampling(vertex_graph(strip(4, 3)), count, first=np.array(first, dtype=np.int64))


@outcomes
def calls() -> Values:
    """What the calls of a table return, or the sentence with which they are refused."""
    names = {name: getattr(sshade, name) for name in sshade.__all__} | globals()
    for call in Path(__file__).with_name("calls.txt").read_text("utf-8").splitlines():
        try:
            yield call, eval(call, names)
        except (TypeError, ValueError) as error:
            yield call, f"{type(error).__name__}: {error}"


@scene
def fast() -> Values:
    yield from solved(patches(), vertices=400)


@scene
def fine() -> Values:
    yield from solved(patches(LIMB, 30), method="fine", vertices=300)


@scene
def paper() -> Values:
    yield from solved(patches(), method="paper", vertices=300, samplings=3)
    yield from solved(
        patches(), method="paper", vertices=200, samplings=1, accelerate=False, max_iterations=9
    )


@scene
def regions() -> Values:
    yield from solved(patches(count=500), vertices=400)
    yield from solved(patches(LIMB, 600), method="fine", vertices=300, thickness=0.5)


@outcomes
def soft_and_turned() -> Values:
    yield from solved(patches(weights=[np.inf, 3.0]), vertices=300)
    rotations = [None, rotation(4)]
    yield from solved(patches(LIMB, 4, rotations=rotations, weights=[np.inf, 20.0]), vertices=300, joints=0)
    yield from solved(patches(LIMB, 1, rotations=rotations), method="fine", vertices=200)


@outcomes
def options() -> Values:
    task = patches(count=8)
    yield from solved(task, vertices=200, volume_goal=1.15)
    yield from solved(task, vertices=200, samplings=2, seed=3, volume=1.0, area=1.0)
    yield from solved(task, vertices=200, frames="triangle", bending=0.05, strain_limit=0.1, start="rest")
    yield from solved(task, vertices=200, method="fine", detail=0.9, polish_iterations=7)
    yield from solved(replace(task, guess=bent(task.mesh.V, 0.05)), vertices=200, workers=2)


@scene
def dense() -> Values:
    index = np.arange(0, BODY.n, 5)
    task = DeformationTask("t", BODY, Handles(index, bent(BODY.V)[index]))
    yield from solved(task, method="interpolate")
    yield from solved(task, vertices=400)
    pair, half = Mesh(9 * TOUCHING.V, TOUCHING.F), np.arange(0, SMALL.n, 2)
    own = Handles(half, 9 * bent(SMALL.V)[half])
    yield from solved(DeformationTask("t", pair, own), method="interpolate")


@scene
def memory_of_dense() -> Values:
    mesh = bumpy(5)
    index = np.arange(0, mesh.n, 2)
    task = DeformationTask("t", mesh, Handles(index, bent(mesh.V)[index]))
    yield "everywhere", deform(task, method="interpolate").vertices


@scene
def memory_of_crowded() -> Values:
    mesh = bumpy(6)
    index = np.flatnonzero(mesh.V[:, 2] > 1.2)
    task = DeformationTask("t", mesh, Handles(index, bent(mesh.V)[index]))
    yield "in one place", deform(task, method="interpolate").vertices


@scene
def coarser() -> Values:
    """A proxy that is large enough for a coarser one, as if it were."""
    with mock.patch("sshade.method.proxy_solver.SMALLEST", 200):
        yield from solved(patches(count=4, turn=1.0), vertices=600, coarser=2, seed=7)
        yield from solved(patches(count=4, turn=1.0), vertices=600, coarser=2, joints=0, method="fine")
        for count in (150, 2):
            task = patches(count=count)
            yield f"{count}", deform(task, vertices=600).facts
            yield f"{count} with a guess", deform(replace(task, guess=bent(BODY.V)), vertices=600).facts


@scene
def components() -> Values:
    small = bumpy(3)
    mesh = beside(small, shifted(small, [4, 0, 0]), shifted(bumpy(2), [2, 3, 0]), shifted(small, [0, 0, 9]))
    own = end_handles(small.V, count=8, shift=[0.3, 0, 0.2])
    index = np.concatenate([own.index, own.index + small.n])
    target = np.concatenate([own.target, mesh.V[own.index + small.n] + [0, 0.5, 0]])
    group = np.repeat([0, 1, 2], [8, 8, 16])
    yield from solved(DeformationTask("t", mesh, Handles(index, target, group=group)), vertices=300)


@outcomes
def cut() -> Values:
    for mesh in (t_fin(8), moebius(60), strip(40, 8)):
        axis = int(np.argmax(np.ptp(mesh.V, axis=0)))
        task = DeformationTask("t", mesh, end_handles(mesh.V, axis=axis, shift=0.2 * np.ptp(mesh.V, axis=0)))
        yield from solved(task, vertices=100)
        yield from solved(task, vertices=100, method="fine", polish_iterations=5)
    # The pose before, as in a sequence, is where a solve of a surface with junctions starts.
    task = DeformationTask("t", t_fin(8), end_handles(t_fin(8).V, axis=0, shift=[0.3, 0, 0.4]))
    yield from solved(replace(task, guess=bent(task.mesh.V, 0.5)), vertices=100, max_iterations=2)


@scene
def memory() -> Values:
    """A mesh that is large beside its proxy."""
    yield from solved(patches(bumpy(6), 40), vertices=100, max_iterations=3)


@scene
def memory_of_fine() -> Values:
    yield from solved(
        patches(bumpy(5), 40), vertices=100, method="fine", max_iterations=3, polish_iterations=3
    )


@outcomes
def teams() -> Values:
    """The threads that share the work of each function on a machine with three CPUs, and its parts."""
    found, share = set[str](), ThreadTeam.__call__

    def note(words: str) -> None:
        at = sys._getframe(2)
        while at.f_code.co_filename == threads.__file__:
            at = at.f_back
        found.add(f"{at.f_globals['__name__']}.{at.f_code.co_qualname} {words}")

    def noted(self: ThreadTeam, chunk: Any, count: int) -> list[Any]:
        note(f"{min(self.workers, count)} for {count}")
        return share(self, chunk, count)

    class Tree(cKDTree):
        def query(self, *points: Any, workers: int = 1, **more: Any) -> Any:
            note(f"by a tree {workers}")
            return super().query(*points, workers=workers, **more)

    task = patches(bumpy(5), 40)
    write_mesh("large.ply", task.mesh.V, task.mesh.F)
    write_handles("handles.json", task.handles)
    half = np.arange(0, task.mesh.n, 2)
    bind = partial(Deformer, task.mesh, task.handles.index, vertices=1400)
    calls = {
        method: partial(
            deform, replace(task, mesh=read_mesh("large.ply")), vertices=1400, max_iterations=2, method=method
        )
        for method in ("fast", "paper", "fine")
    } | {
        "command": partial(
            main, ["deform", "large.ply", "handles.json", "-o", "out.ply", "--with", "large.ply"]
        ),
        "drag": lambda: bind().step(task.handles.target),
        "search": partial(opposite_vertices, task.mesh),
        "interpolate": partial(deform, task.mesh, half, bent(task.mesh.V, 0.5)[half], method="interpolate"),
    }
    with (
        mock.patch("os.sched_getaffinity", lambda _: set(range(3)), create=True),
        mock.patch.object(ThreadTeam, "__call__", noted),
        ExitStack() as stack,
    ):
        for name in SHARED_FROM:
            stack.enter_context(mock.patch(f"sshade.{name}", 300 if name.endswith("ROWS") else 500))
        for name in ("interpolation.splines", "mesh.quality", "proxy.along"):
            stack.enter_context(mock.patch(f"sshade.{name}.cKDTree", Tree))
        for label, call in calls.items():
            found.clear()
            call()
            yield label, sorted(found)

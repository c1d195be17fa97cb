"""Cases: the same of the functions of Python."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from sshade import (
    DeformationResult,
    DeformationTask,
    Deformer,
    Handles,
    Mesh,
    TransferTask,
    bind,
    deform,
    reconstruct,
    transfer_pose,
)
from sshade.io.meshes import write_mesh
from sshade.sampling.remesh import remesh
from sshade.solver.local_global import LocalGlobal, local_global
from tests.robustness.case import Case
from tests.robustness.inputs import BODY, pose

V, F = BODY.V, BODY.F
NAN = np.where(np.arange(BODY.n)[:, None] == 3, np.nan, V)
HELD = [0, 1, 2, 50]


def _task(**changes: Any) -> DeformationTask:
    return DeformationTask(**{"name": "body", "mesh": BODY, "handles": pose(V), **changes})


def _refused(name: str, call: Callable[[], Any], *says: str) -> Case:
    return Case(f"Python, {name}", call, says=says)


def _deform(**parameters: Any) -> Callable[[], Any]:
    return lambda: deform(_task(), **{"vertices": 60, "samplings": 2, **parameters})


def _short(task: DeformationTask, *, seed: int, progress: Any = None) -> DeformationResult:
    """A coarse method that loses a vertex."""
    return DeformationResult(task.mesh.V[1:], iterations=1, converged=True)


def _deformer(**parameters: Any) -> Deformer:
    return Deformer(BODY, HELD, **{"vertices": 60, **parameters})


def _transfer(posed: Any = V, edited: Any = V, **parameters: Any) -> Callable[[], Any]:
    return lambda: transfer_pose(BODY, posed, edited, **{"vertices": 60, "samplings": 2, **parameters})


MESHES = [
    _refused("Mesh: positions in two dimensions", lambda: Mesh(V[:, :2], F), "(n, 3)", "(162, 2)"),
    _refused("Mesh: quadrangles", lambda: Mesh(V, np.zeros((4, 4), dtype=int)), "triangles", "(4, 4)"),
    _refused("Mesh: faces of floats", lambda: Mesh(V, F.astype(float)), "integers, not float64"),
    _refused(
        "Mesh: nothing", lambda: Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=int)), "at least one triangle"
    ),
    _refused("Mesh: NaN", lambda: Mesh(NAN, F), "vertex 3 has a NaN"),
    _refused("Mesh: sizes of 1e100", lambda: Mesh(V * 1e100, F), "scale it"),
    _refused("Mesh: a face out of range", lambda: Mesh(V[:-1], F), "the ids go from 0 to 160"),
    _refused("write_mesh: an unknown suffix", lambda: write_mesh("a.gltf", V, F), "unknown mesh format"),
]
HANDLES = [
    _refused("Handles: none", lambda: Handles([], np.zeros((0, 3))), "no handles"),
    _refused("Handles: ids of floats", lambda: Handles([0.5], V[:1]), "integers"),
    _refused("Handles: a negative id", lambda: Handles([-1], V[:1]), "negative"),
    _refused(
        "Handles: fewer targets", lambda: Handles([0, 1], V[:1]), "2 handles need targets of shape (2, 3)"
    ),
    _refused("Handles: a NaN target", lambda: Handles([0], [[np.nan, 0, 0]]), "NaN or infinite"),
    _refused(
        "Handles: contradictory targets", lambda: Handles([4, 4], V[:2]), "vertex 4 has contradictory targets"
    ),
    _refused("Handles: groups of another length", lambda: Handles([0], V[:1], group=[1, 2]), "`group`"),
    _refused("Handles: by position, NaN", lambda: Handles.from_positions(BODY, NAN[3:4], V[:1]), "NaN"),
    _refused(
        "Handles: by position, fewer targets",
        lambda: Handles.from_positions(BODY, V[:2], V[:1]),
        "2 handles have 1",
    ),
]
TASKS = [
    _refused(
        "task: a handle beyond the mesh",
        lambda: _task(handles=Handles([162], V[:1])),
        "id 162 is out of range",
    ),
    _refused("task: a truth of another shape", lambda: _task(truth=V[1:]), "truth has shape (161, 3)"),
    _refused("task: a guess of another shape", lambda: _task(guess=V[:, :2]), "guess has shape (162, 2)"),
    _refused(
        "task: a transfer of other faces", lambda: TransferTask("t", BODY, Mesh(V, F[::-1]), V), "other faces"
    ),
    _refused("task: a transfer to NaN", lambda: TransferTask("t", BODY, BODY, NAN), "NaN"),
]
DEFORM = [
    _refused("deform: no samplings", _deform(samplings=0), "0 samplings"),
    _refused("deform: too many proxy vertices", _deform(vertices=163), "the mesh has only 162"),
    _refused("deform: too few proxy vertices", _deform(vertices=3), "cannot hold the"),
    _refused("deform: unknown frames", _deform(frames="round"), "unknown frames 'round'"),
    _refused("deform: an unknown projection", _deform(projection="up"), "unknown projection 'up'"),
    _refused("deform: an unknown function of frames", _deform(frame_function="w"), "'w'"),
    _refused(
        "deform: a function of frames of another length", _deform(frame_function=np.ones(5)), "162 values"
    ),
    _refused("deform: a function of frames with NaN", _deform(frame_function=NAN[:, 0]), "finite"),
    _refused("deform: an unknown handle mode", _deform(handle_mode="all"), "unknown handle mode 'all'"),
    _refused("deform: no workers", _deform(workers=0), "0 workers"),
    _refused("deform: a negative seed", _deform(seed=-1), "seed -1 is negative"),
    _refused("deform: a coarse method that loses a vertex", _deform(coarse=_short), "shape"),
    _refused(
        "deform: an unknown start", _deform(coarse=partial(local_global, start="up")), "unknown start 'up'"
    ),
    _refused("deform: a negative weight", _deform(coarse=partial(local_global, volume=-1.0)), "-1"),
    _refused("remesh: a first vertex beyond the mesh", lambda: remesh(BODY, 60, first=[162]), "0..161"),
    _refused("remesh: a first vertex twice", lambda: remesh(BODY, 60, first=[3, 3]), "repeat"),
    _refused("bind: unknown frames", lambda: bind(BODY, 60, frames="x"), "unknown frames"),
]
BOUND = [
    _refused("carry: a proxy of another size", lambda: bind(BODY, 60).carry(V), "(162, 3)"),
    _refused("carry: a proxy with NaN", lambda: _carry_nan(), "NaN"),
    _refused("Deformer: no samplings", lambda: _deformer(samplings=0), "0 samplings"),
    _refused("Deformer: no handles", lambda: Deformer(BODY, [], vertices=60), "at least one vertex"),
    _refused("Deformer: a handle twice", lambda: Deformer(BODY, [3, 3], vertices=60), "repeat"),
    _refused("Deformer: a handle beyond the mesh", lambda: Deformer(BODY, [162], vertices=60), "0..161"),
    _refused("Deformer: fewer targets", lambda: _deformer()(V[:2]), "4 handles need targets of shape (4, 3)"),
    _refused("Deformer: a NaN target", lambda: _deformer()(NAN[:4]), "NaN"),
    _refused(
        "LocalGlobal: a start of another shape",
        lambda: LocalGlobal(BODY, HELD).solve(V[HELD], start=V[1:]),
        "start",
    ),
    _refused(
        "LocalGlobal: a window of 0", lambda: LocalGlobal(BODY, HELD).solve(V[HELD], window=0), "window"
    ),
    _refused("transfer: a pose of other counts", _transfer(posed=V[1:]), "posed", "they must correspond"),
    _refused("transfer: an edit of other counts", _transfer(edited=V[1:]), "edited", "they must correspond"),
    _refused("transfer: NaN", _transfer(posed=NAN), "NaN"),
    _refused("transfer: no samplings", _transfer(samplings=0), "0 samplings"),
    _refused("reconstruct: a pose with NaN", lambda: reconstruct(BODY, NAN, vertices=60), "NaN"),
]


def _carry_nan() -> Any:
    binding = bind(BODY, 60)
    return binding.carry(np.full_like(binding.proxy.V, np.nan))


CASES = [*MESHES, *HANDLES, *TASKS, *DEFORM, *BOUND]

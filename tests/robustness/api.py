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
    transfer_pose,
)
from sshade.sampling.proxy import sample_proxy
from sshade.solver.local_global import LocalGlobal, local_global
from tests.robustness.case import Case
from tests.robustness.inputs import BODY, pose

V, F = BODY.V, BODY.F
NAN = np.where(np.arange(BODY.n)[:, None] == 3, np.nan, V)
HELD = [0, 1, 2, 50]


def _task(**changes: Any) -> DeformationTask:
    return DeformationTask(**{"name": "body", "mesh": BODY, "handles": pose(V), **changes})


def _deform(**parameters: Any) -> Callable[[], Any]:
    return lambda: deform(_task(), method="paper", **{"vertices": 60, "samplings": 2, **parameters})


def _short(task: DeformationTask, *, seed: int, progress: Any = None) -> DeformationResult:
    """A coarse method that loses a vertex."""
    return DeformationResult(task.mesh.V[1:], iterations=1, converged=True)


def _deformer(**parameters: Any) -> Deformer:
    return Deformer(BODY, HELD, **{"vertices": 60, **parameters})


def _transfer(posed: Any = V, edited: Any = V, **parameters: Any) -> Callable[[], Any]:
    return lambda: transfer_pose(BODY, posed, edited, **{"vertices": 60, "samplings": 2, **parameters})


def _solve(**parameters: Any) -> Callable[[], Any]:
    return lambda: LocalGlobal(BODY, HELD).solve(V[HELD], **parameters)


ONE = V[:1]
REFUSED: dict[str, tuple[Callable[[], Any], str]] = {
    "Mesh: positions in two dimensions": (lambda: Mesh(V[:, :2], F), "(162, 2)"),
    "Mesh: quadrangles": (lambda: Mesh(V, np.zeros((4, 4), dtype=int)), "(4, 4)"),
    "Mesh: faces of floats": (lambda: Mesh(V, F.astype(float)), "integers, not float64"),
    "Mesh: nothing": (lambda: Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=int)), "at least one triangle"),
    "Mesh: sizes of 1e100": (lambda: Mesh(V * 1e100, F), "scale it"),
    "Handles: none": (lambda: Handles([], V[:0]), "no handles"),
    "Handles: ids of floats": (lambda: Handles([0.5], ONE), "integers"),
    "Handles: a negative id": (lambda: Handles([-1], ONE), "negative"),
    "Handles: fewer targets": (lambda: Handles([0, 1], ONE), "(2, 3)"),
    "Handles: a NaN target": (lambda: Handles([0], [[np.nan, 0, 0]]), "NaN or infinite"),
    "Handles: contradictory targets": (lambda: Handles([4, 4], V[:2]), "vertex 4"),
    "Handles: groups of another length": (lambda: Handles([0], ONE, group=[1, 2]), "`group`"),
    "Handles: by position, NaN": (lambda: Handles.from_positions(BODY, NAN[3:4], ONE), "NaN"),
    "Handles: by position, fewer targets": (lambda: Handles.from_positions(BODY, V[:2], ONE), "2 handles"),
    "task: a handle beyond the mesh": (lambda: _task(handles=Handles([162], ONE)), "id 162 is out of range"),
    "task: a truth of another shape": (lambda: _task(truth=V[1:]), "truth has shape (161, 3)"),
    "task: a guess of another shape": (lambda: _task(guess=V[:, :2]), "guess has shape (162, 2)"),
    "transfer task: other faces": (lambda: TransferTask("t", BODY, Mesh(V, F[::-1]), V), "other faces"),
    "transfer task: NaN": (lambda: TransferTask("t", BODY, BODY, NAN), "NaN"),
    "deform: no samplings": (_deform(samplings=0), "samplings must be a whole number in [1, inf), not 0"),
    "deform: unknown frames": (_deform(frames="round"), "not 'round'"),
    "deform: an unknown function of frames": (_deform(frame_function="w"), "'w'"),
    "deform: a function of frames too short": (_deform(frame_function=np.ones(5)), "162 values"),
    "deform: a function of frames with NaN": (_deform(frame_function=NAN[:, 0]), "finite"),
    "deform: a coarse method that loses a vertex": (_deform(coarse=_short), "shape"),
    "deform: an unknown start": (_deform(coarse=partial(local_global, start="up")), "not 'up'"),
    "deform: a negative weight": (_deform(coarse=partial(local_global, volume=-1.0)), "-1"),
    "remesh: a first vertex beyond the mesh": (lambda: sample_proxy(BODY, 60, first=[162]), "0..161"),
    "remesh: a first vertex twice": (lambda: sample_proxy(BODY, 60, first=[3, 3]), "repeat"),
    "bind: unknown frames": (lambda: bind(BODY, 60, frames="x"), "unknown frames"),
    "carry: a proxy of another size": (lambda: bind(BODY, 60).carry(V), "(162, 3)"),
    "Deformer: no samplings": (
        lambda: _deformer(samplings=0),
        "samplings must be a whole number in [1, inf), not 0",
    ),
    "Deformer: no handles": (lambda: Deformer(BODY, [], vertices=60), "have no handle"),
    "Deformer: a handle twice": (lambda: Deformer(BODY, [3, 3], vertices=60), "given twice"),
    "Deformer: a handle beyond the mesh": (lambda: Deformer(BODY, [162], vertices=60), "out of range"),
    "Deformer: fewer targets": (lambda: _deformer()(V[:2]), "(4, 3)"),
    "Deformer: a NaN target": (lambda: _deformer()(NAN[:4]), "NaN"),
    "LocalGlobal: a start of another shape": (_solve(start=V[1:]), "start"),
    "LocalGlobal: a window of 0": (_solve(window=0), "window"),
    "transfer: a pose of other counts": (_transfer(posed=V[1:]), "posed"),
    "transfer: an edit of other counts": (_transfer(edited=V[1:]), "edited"),
    "transfer: NaN": (_transfer(posed=NAN), "NaN"),
    "transfer: no samplings": (_transfer(samplings=0), "samplings must be a whole number in [1, inf), not 0"),
}
CASES = [Case(f"Python, {name}", call, says=(word,)) for name, (call, word) in REFUSED.items()]

"""Do the work that the kernels of ``sshade`` are for, and count the compilations of each part.

``python tools/first_actions.py MESH HANDLES`` writes ``compilations.json``. :mod:`tools.first_minute` calls
it with the Python of a fresh environment.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numba.core import event

import sshade
from sshade.cli.main import main as run
from sshade.edit.groups import Motion
from sshade.edit.session import Session
from sshade.options import PRESETS

FORMATS = ("ply", "obj", "off", "stl", "glb", "gltf")


class Compilations(event.Listener):
    """Counts the functions that numba compiles."""

    number = 0

    def on_start(self, event: event.Event) -> None:
        self.number += 1

    def on_end(self, event: event.Event) -> None:
        pass


def main(mesh: str, handles: str) -> None:
    """Do the work and write the numbers."""
    counter, numbers = Compilations(), {}
    event.register("numba:compile", counter)
    actions: dict[str, Callable[[], Any]] = {
        "all methods": lambda: [
            command("deform", mesh, handles, "-o", f"{m}.ply", "--method", m) for m in PRESETS
        ],
        "all formats": lambda: formats(mesh, handles),
        "handle regions and components": lambda: regions(mesh),
        "remesh, carry, reconstruct, transfer-pose": lambda: other_commands(mesh),
        "drags of `Deformer`": lambda: drags(mesh),
        "the editor": lambda: editor(mesh),
    }
    for name, action in actions.items():
        before = counter.number
        action()
        numbers[name] = counter.number - before
    Path("compilations.json").write_text(json.dumps(numbers))


def command(*arguments: str) -> None:
    """Run a command of ``sshade``."""
    if run(list(arguments)):
        raise SystemExit(f"sshade {' '.join(arguments)} failed")


def formats(mesh: str, handles: str) -> None:
    """Deform copies of a mesh in all formats, with its normals."""
    V, F = sshade.read(mesh)
    for suffix in FORMATS:
        sshade.write(f"copy.{suffix}", V, F)
        command("deform", f"copy.{suffix}", handles, "-o", f"out.{suffix}")
    rows = [f"v {x} {y} {z}\nvn {x} {y} {z}" for x, y, z in V] + [
        f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in F + 1
    ]
    Path("normals.obj").write_text("\n".join(rows))
    command("deform", "normals.obj", handles, "-o", "out.obj")


def regions(mesh: str) -> None:
    """Deform two components through regions."""
    V, F = sshade.read(mesh)
    both = np.concatenate([V, V + [8, 0, 0]])
    sshade.write("two.ply", both, np.concatenate([F, F + len(V)]))
    eye, up = np.eye(3).tolist(), [0.0, 0.0, 1.0]
    groups: list[dict[str, Any]] = []
    for x in (0, 8):
        for side, kind in ((x - 4, "static"), (x + 2, "dynamic")):
            box = [[side, -4, -2], [side + 2, 4, 2]]
            group = {"landmark": f"{x} {side}", "kind": kind, "boxes": [box]}
            groups.append(group | ({"rotation": eye, "translation": up} if kind == "dynamic" else {}))
    Path("two.json").write_text(json.dumps({"handles": groups}))
    for method in ("fast", "fine", "paper"):
        command("deform", "two.ply", "two.json", "-o", "two_posed.ply", "--method", method)


def other_commands(mesh: str) -> None:
    """Run the commands that need no handles."""
    V, F = sshade.read(mesh)
    sshade.write("edited.ply", V * [1, 1, 1.2], F)
    command("remesh", mesh, "-o", "proxy.ply", "--map", "map.npz", "--vertices", "1000")
    for frames in ("triangle", "affine", "blended", "blended_affine"):
        command("carry", mesh, "map.npz", "proxy.ply", "-o", "carried.ply", "--frames", frames)
        command("reconstruct", mesh, "fast.ply", "-o", "rebuilt.ply", "--frames", frames)
    command("transfer-pose", mesh, "fast.ply", "edited.ply", "-o", "transferred.ply")


def drags(mesh: str) -> None:
    """Drag vertices and regions of a bound mesh, and let it converge."""
    V, F = sshade.read(mesh)
    low, high = np.flatnonzero(V[:, 0] < -2), np.flatnonzero(V[:, 0] > 2)
    for ends in ((low[::50], high[::50]), (low, high)):
        index = np.concatenate(ends)
        group = np.repeat([0, 1], [len(end) for end in ends])
        drag = sshade.Deformer(sshade.Mesh(V, F), index, group=group)
        for step in (0.5, 1.0):
            drag(V[index] + step * group[:, None] * [0, 0, 1], tolerance=1e-4)
        drag(V[index] + group[:, None] * [0, 0, 1])


def editor(mesh: str) -> None:
    """Pick, mark, drag, undo, redo and save in a session of the editor."""
    session = Session(Path(mesh))
    V = session.mesh.V
    for side, kind in ((V[:, 0] < -2, "static"), (V[:, 0] > 2, "moving")):
        session.select(np.flatnonzero(side), "replace")
        for how in ("grow", "shrink"):
            session.select(np.array([], dtype=np.int64), how)
        number = session.mark(kind)
    motion = Motion(np.eye(3), np.array([0.0, 0.0, 1.0]))
    session.drag(number, motion)
    session.release(number, motion)
    session.settle()
    session.undo()
    session.redo()
    session.settle()
    session.save("handles", "session.json", over=True)
    session.save("mesh", "session.ply", over=True)


if __name__ == "__main__":
    main(*sys.argv[1:])

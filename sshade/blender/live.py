# SPDX-License-Identifier: MIT OR GPL-3.0-or-later
"""The live mode: a mesh is bound once, and a shape key follows the handles while they move."""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent

from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.edit.groups import Motion

from .data import add_key, corners, read_motions, read_rig, rest_positions, switch_off, write_key

#: Errors of computations that end a live mode with a message.
FAILURES = (InputError, FloatingPointError, MemoryError)
#: Seconds between the last motion and further iterations, and between the iterations.
PAUSE, BEAT = 0.15, 0.02
#: Movement of an iteration, as a fraction of the diagonal, below which the shape is at rest.
AT_REST = 1e-4
#: Largest number of further iterations.
LONGEST = 60

#: Live modes by the identifier of their object, which outlasts undo and renaming.
RUNNING: dict[int, Live] = {}


class Live:
    """A live mode of an object.

    Parameters
    ----------
    obj : Object
        A mesh in object mode that has handles. It gets a shape key, which follows the handles.

    Raises
    ------
    InputError
        When the handles cannot be used; the object is unchanged then.
    """

    def __init__(self, obj: bpy.types.Object) -> None:
        self.rig = read_rig(obj)
        motions = read_motions(obj)
        self._corners = corners(obj.data)
        self._deformer = self.rig.bound()
        self._uid, self._left = obj.session_uid, 0
        self._shape, self._motions = self.rig.step(self._deformer, motions), motions
        self._had_keys, self._earlier = obj.data.shape_keys is not None, switch_off(obj)
        key = add_key(obj)
        self._key = key.name
        write_key(obj, key, self._shape)

    @property
    def object(self) -> bpy.types.Object | None:
        """The object, None if it was deleted."""
        return next((obj for obj in bpy.data.objects if obj.session_uid == self._uid), None)

    def key(self, obj: bpy.types.Object) -> bpy.types.ShapeKey:
        """Return the shape key, and raise InputError if it is gone."""
        keys = obj.data.shape_keys
        key = keys.key_blocks.get(self._key) if keys else None
        if key is None:
            raise InputError(f"the live mode ended, because its shape key {self._key!r} is gone")
        return key

    def follow(self) -> bool:
        """Take a step if a handle has moved; return whether it has.

        A motion that is not rigid is reported and left out, so that the user can correct it.

        Raises
        ------
        InputError
            When the mode cannot go on.
        """
        obj = self.object
        if obj is None:
            raise InputError("the live mode ended, because its object is gone")
        if edited(obj):  # the mesh has its new positions when the mode ends
            return False
        if not self._same_handles(obj):
            raise InputError("the live mode ended, because the list of groups changed; start it again")
        try:
            motions = read_motions(obj)
        except InputError as error:
            tell(obj, str(error))
            return False
        tell(obj, "")
        if self._same(motions):
            return False
        self._left = LONGEST
        self._step(obj, motions)
        return True

    def settle(self) -> float | None:
        """Take a further step to the last motions; return the seconds to the next one, None at the end."""
        obj, before = self.object, self._shape
        if obj is None or edited(obj) or not self._left:
            return None
        self._left -= 1
        self._step(obj, self._motions)
        moved = float(np.abs(self._shape - before).max())
        return BEAT if moved > AT_REST * self.rig.mesh.diagonal else None

    def finish(self, obj: bpy.types.Object) -> str:
        """Write the converged shape as the operator Deform computes it; return its quality."""
        V, quality = deformed(obj)  # weights may be others than at the start
        write_key(obj, self.key(obj), V)
        return quality

    def cancel(self, obj: bpy.types.Object) -> None:
        """Remove the shape key, and switch earlier keys of this extension on again."""
        obj.shape_key_remove(self.key(obj))
        if not self._had_keys:
            drop_lone_basis(obj)
        for key in obj.data.shape_keys.key_blocks if obj.data.shape_keys else ():
            key.value = self._earlier.get(key.name, key.value)

    def require_unchanged(self, obj: bpy.types.Object) -> None:
        """Raise InputError if the mesh changed since it was bound."""
        mesh = obj.data
        same = len(mesh.vertices) == len(self.rig.V) and np.array_equal(corners(mesh), self._corners)
        if same and np.array_equal(rest_positions(mesh), self.rig.V):
            return
        raise InputError(
            f"the live mode ended, because mesh {mesh.name!r} was edited; its shape key stays, and the live "
            "mode can start again"
        )

    def _same_handles(self, obj: bpy.types.Object) -> bool:
        return obj.sshade.handles.keys() == [group.name for group in self.rig.groups]

    def _same(self, motions: list[Motion]) -> bool:
        same = map(np.array_equal, chain(*motions), chain(*self._motions))
        return len(motions) == len(self._motions) and all(same)

    def _step(self, obj: bpy.types.Object, motions: list[Motion]) -> None:
        self.require_unchanged(obj)
        key = self.key(obj)
        self._shape, self._motions = self.rig.step(self._deformer, motions), motions
        write_key(obj, key, self._shape)


def deformed(obj: bpy.types.Object, progress: Progress = silent) -> tuple[np.ndarray, str]:
    """Return the converged shape of the present handles, and its quality."""
    own = obj.sshade
    return read_rig(obj).deform(read_motions(obj), method=own.method, joints=own.joints, progress=progress)


def edited(obj: bpy.types.Object) -> bool:
    """Whether an object is not in object mode, or its mesh is edited through another object."""
    return obj.mode != "OBJECT" or obj.data.is_editmode


def drop_lone_basis(obj: bpy.types.Object) -> None:
    """Remove the basis that the extension added, if no other shape key is left."""
    keys = obj.data.shape_keys
    if keys and len(keys.key_blocks) == 1 and keys.reference_key.name == "Basis":
        obj.shape_key_remove(keys.reference_key)


def tell(obj: bpy.types.Object, message: str) -> None:
    """Show a message in the panel."""
    if obj.sshade.message != message:
        obj.sshade.message = message


def _of_all(step: Callable[[Live], Any]) -> list[Any]:
    """Return what a method returns for each live mode; one that fails ends with a message.

    The last shape stays.
    """
    results = []
    for uid, live in list(RUNNING.items()):
        try:
            results.append(step(live))
        except FAILURES as error:
            obj = RUNNING.pop(uid).object
            if obj is not None:
                tell(obj, str(error))
            print(f"sshade: {error}")  # noqa: T201
    return results


@persistent
def follow_handles(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Let all live modes follow their handles after a change of the scene."""
    moved = _of_all(Live.follow)
    if any(moved) and not bpy.app.background:
        if bpy.app.timers.is_registered(settle_all):
            bpy.app.timers.unregister(settle_all)
        bpy.app.timers.register(settle_all, first_interval=PAUSE)


def settle_all() -> float | None:
    """Take a further step of all live modes; return the seconds to the next one, None at the end."""
    intervals = _of_all(Live.settle)
    return BEAT if any(intervals) else None


@persistent
def forget_all(*_: object) -> None:
    """End all live modes before another file is loaded."""
    RUNNING.clear()


#: Functions that Blender calls, by the list of its handlers.
HANDLERS = {
    "depsgraph_update_post": follow_handles,
    "frame_change_post": follow_handles,
    "undo_post": follow_handles,
    "redo_post": follow_handles,
    "load_pre": forget_all,
}


def register() -> None:
    for name, function in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(function)


def unregister() -> None:
    RUNNING.clear()
    for name, function in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(function)

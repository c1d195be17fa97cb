"""Recovery files: the unsaved groups of a session, written after each step and offered at the next start."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
from contextlib import suppress
from functools import cached_property
from glob import escape
from math import inf, isfinite
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sshade.core.errors import InputError
from sshade.core.whole_files import INCOMPLETE, expecting, read_npz, replacing
from sshade.edit.groups import Group
from sshade.edit.state import EditState
from sshade.mesh.mesh import Mesh
from sshade.problem.options import require_method

#: How messages name a recovery file.
WHAT = "a recovery file of `sshade edit`"


class Offer(NamedTuple):
    """A recovery file that an editor left when it was killed or ended without saving.

    Attributes
    ----------
    path : path
    time : float
        Time of the last step, in seconds since 1970.
    groups : int
        Number of groups.
    """

    path: Path
    time: float
    groups: int


class Recovery:
    """The recovery file of a session, and recovery files of earlier sessions of the mesh.

    Several editors may have one mesh open: each writes a file of its own, and offers no file of an editor
    that still runs.

    Parameters
    ----------
    beside : path
        File of the mesh. Recovery files are in its folder, and their names begin with its name.
    mesh : Mesh

    Attributes
    ----------
    path : path
        File of this session, which exists while there is unsaved work.
    offers : list of Offer
        Files of earlier sessions, latest first.
    """

    def __init__(self, beside: Path, mesh: Mesh) -> None:
        self._mesh = mesh
        self.path = beside.with_name(f"{beside.name}.recovery-{secrets.token_hex(3)}.npz")
        self.offers: list[Offer] = []
        for path in list(beside.parent.glob(f"{escape(beside.name)}.recovery-*.npz")):
            with suppress(InputError, OSError, KeyError, ValueError):  # a damaged file has nothing to offer
                facts = json.loads(str(read_npz(path, "facts", what=WHAT)["facts"]))
                written = path.stat().st_mtime
                if not _is_running(facts["process"], since=written):
                    self.offers.append(Offer(path, written, len(facts["groups"])))
        self.offers.sort(key=lambda offer: -offer.time)

    def write(self, state: EditState) -> None:
        """Write the groups, options and selection of a state.

        Raises
        ------
        InputError
            When the file cannot be written.
        """
        arrays: dict[str, np.ndarray] = {"selection": state.selection}
        for i, group in enumerate(state.groups):
            arrays |= {f"vertices_{i}": group.vertices, f"target_{i}": group.target}
            arrays |= {} if group.turn is None else {f"turn_{i}": group.turn}
        groups = [
            {
                "name": group.name,
                "kind": group.kind,
                "is_prescribed": group.is_prescribed,
                "weight": group.weight if isfinite(group.weight) else None,
            }
            for group in state.groups
        ]
        facts = {"mesh": self._digest, "process": os.getpid(), "made": state.made, "groups": groups}
        with replacing(self.path) as temporary, open(temporary, "wb") as file:
            np.savez(file, facts=json.dumps(facts), **arrays)  # type: ignore[arg-type]

    def read(self, path: Path, *, first: int) -> EditState:
        """Read a recovery file; `first` is the number of the first group.

        Raises
        ------
        InputError
            When the file is unreadable or belongs to another mesh.
        """
        arrays = read_npz(path, what=WHAT)
        with expecting(WHAT, path, errors=INCOMPLETE):
            facts = json.loads(str(arrays["facts"]))
            if facts["mesh"] != self._digest:
                other = "another mesh, or of this mesh with another --weld or --repair"
                raise InputError(f"{path}: is a recovery file of {other}")
            groups = [
                Group(
                    number=first + i,
                    name=entry["name"],
                    kind=entry["kind"],
                    vertices=arrays[f"vertices_{i}"],
                    target=arrays[f"target_{i}"],
                    weight=inf if entry["weight"] is None else entry["weight"],
                    turn=arrays.get(f"turn_{i}"),
                    is_prescribed=entry["is_prescribed"],
                )
                for i, entry in enumerate(facts["groups"])
            ]
            method = require_method(facts["made"].pop("method"))
            return EditState(arrays["selection"], tuple(groups), method, facts["made"])

    def remove(self) -> None:
        """Remove the file of this session, if it exists."""
        with suppress(OSError):
            self.path.unlink(missing_ok=True)

    def withdraw(self, path: Path) -> None:
        """Remove an offered file."""
        for offer in self.offers:
            if offer.path.resolve() == path.resolve():
                with suppress(OSError):
                    offer.path.unlink(missing_ok=True)
        self.offers = [offer for offer in self.offers if offer.path.exists()]

    @cached_property
    def _digest(self) -> str:
        """A digest of the mesh."""
        digest = hashlib.sha256(self._mesh.V.tobytes())
        digest.update(self._mesh.F.tobytes())
        return digest.hexdigest()


def _is_running(process: int, *, since: float) -> bool:
    """Whether a process still runs that ran at a time. A later process may have its number."""
    import psutil

    try:
        return psutil.Process(process).create_time() <= since
    except psutil.Error:
        return False

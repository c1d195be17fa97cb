"""Read handles and tasks from files, and write handles as a file."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sshade.core.errors import InputError
from sshade.core.whole_files import naming, replacing
from sshade.files.handle_files import FILE_RECORDS, read_handle_file
from sshade.files.json_yaml import require_known
from sshade.files.meshes import read_file
from sshade.files.open_shape import on_mesh, on_shape, open_shape
from sshade.mesh.mesh import Mesh
from sshade.problem.handles import Handles
from sshade.problem.task import DeformationTask


def read_handles(
    path: str | os.PathLike[str],
    mesh: Mesh,
    *,
    target: str | os.PathLike[str] | None = None,
    amount: float = 1.0,
    raw: bool = False,
) -> Handles:
    """Read handles for a mesh from a .json or an Implicit-ARAP .yaml file, or from two landmark files.

    Parameters
    ----------
    path : path
        Handle file, or the landmarks of the rest shape.
    mesh : Mesh
        The rest shape that the handles are snapped to.
    target : path, optional
        The landmarks of the target, if `path` has landmarks.
    amount : float
        Fraction of the way that the handles move, from 0 to 2; rotations have this fraction of the angle.
    raw : bool
        Keep the targets of the file as they are; see :meth:`sshade.Handles.from_positions`.

    Raises
    ------
    InputError
        When the file is missing, of another format, inconsistent, or does not fit the mesh.
    """
    paths = (path,) if target is None else (path, target)
    file = read_handle_file(*paths, raw=raw, amount=amount)
    with naming(path):
        return on_mesh(file, mesh, vertex=np.arange(mesh.n), extent=mesh.diagonal)


def read_task(
    mesh: str,
    *,
    handles: str,
    weld: float | None = None,
    repair: bool = False,
) -> DeformationTask:
    """Read a mesh file and a handle file as a task, which is named after both.

    The mesh of the task is the part of the file that can be deformed: see
    :func:`sshade.mesh.surface.surface`.

    Parameters
    ----------
    mesh, handles : path
    weld, repair
        See :func:`sshade.mesh.surface.surface`.

    Raises
    ------
    InputError
        See :func:`sshade.files.meshes.read_file`, :func:`sshade.files.open_shape.open_shape`,
        :func:`read_handles` and :class:`sshade.DeformationTask`.
    """
    file = read_file(mesh)
    with naming(mesh):
        shape = open_shape(file, weld=weld, repair=repair)
    given = read_handle_file(handles)
    with naming(handles):
        own = on_shape(given, shape)
    return shape.task(f"{Path(mesh).stem}/{Path(handles).stem}", own)


def write_handles(
    path: str | os.PathLike[str],
    handles: Handles,
    *,
    names: Mapping[int, str] | None = None,
    about: Mapping[str, Any] | None = None,
    static_at_rest: bool = False,
) -> None:
    """Write handles as this project's JSON, by vertex ids.

    Vertices, targets, kinds, weights and rotations are read back bit by bit, in the order of the groups.
    Targets of static handles are read back with ``raw`` only; otherwise, static handles are read back at
    rest. A group of the file has one kind, one weight and one rotation: hard handles of a group that differ
    in them are read back as several groups. Groups are numbered anew, and snap distances are not in the file.

    Parameters
    ----------
    path : path
    handles : Handles
    names : mapping, optional
        Names of groups. Other groups are named by their number.
    about : mapping, optional
        Further keys of the file that readers of handles ignore. Keys of your own begin with ``_``.
    static_at_rest : bool
        The targets of static handles are their positions at rest, and are left out of the file.

    Raises
    ------
    InputError
        When the file cannot be written or is no .json file, on another key, and when handles of a soft group
        differ in what a group has once: several groups would pull more strongly.
    """
    if Path(path).suffix.lower() != ".json":
        raise InputError(f"{path}: handles are written as .json")
    require_known(about or (), FILE_RECORDS)
    entries = []
    rotation = np.zeros((len(handles), 9)) if handles.rotation is None else handles.rotation.reshape(-1, 9)
    rows = np.column_stack([handles.dynamic, handles.weight, np.nan_to_num(rotation)])
    for group in np.unique(handles.group).tolist():
        own = np.flatnonzero(handles.group == group)
        kinds = np.unique(rows[own], axis=0)
        if np.isfinite(kinds[:, 1]).sum() > 1:
            raise InputError(
                f"the soft handles of group {group} differ in their kinds, weights or rotations, which a "
                "group of a file has once; give them groups of their own"
            )
        for row in kinds:
            members, (dynamic, weight) = own[(rows[own] == row).all(axis=1)], row[:2]
            entry: dict[str, Any] = {
                "name": (names or {}).get(group, group),
                "kind": "moved" if dynamic else "fixed",
                "vertices": handles.index[members].tolist(),
            }
            if dynamic or not static_at_rest:
                entry["target"] = handles.target[members].tolist()
            if np.isfinite(weight):
                entry["weight"] = weight
            if row[2:].any():
                entry["rotation"] = row[2:].reshape(3, 3).tolist()
            entries.append(_lines({key: json.dumps(value) for key, value in entry.items()}, "  "))
    texts = {key: json.dumps(value) for key, value in (about or {}).items()}
    texts["handles"] = "[\n  " + ",\n  ".join(entries) + "\n ]"
    with replacing(path) as temporary:
        temporary.write_text(_lines(texts, "") + "\n", encoding="utf-8")


def _lines(texts: Mapping[str, str], indent: str) -> str:
    """Return the text of a JSON object with a line for each key."""
    lines = ",\n".join(f"{indent} {json.dumps(key)}: {text}" for key, text in texts.items())
    return f"{{\n{lines}\n{indent}}}"

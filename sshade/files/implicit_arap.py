"""Read handle files of Implicit-ARAP: named parts, in its coordinates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sshade.core.errors import InputError, counted
from sshade.core.whole_files import naming
from sshade.files.json_yaml import as_points, decoded, parsed_yaml, require_known


def read_implicit_arap(path: Path) -> list[tuple[np.ndarray, np.ndarray | None]]:
    """Return the points of each part and their targets, None if the part is fixed, in the file's coordinates.

    D. Baieri, F. Maggioli, Z. Laehner, S. Melzi, E. Rodola, "Implicit-ARAP", 2024.
    """
    data = parsed_yaml(path.read_bytes())
    if not isinstance(data, dict) or not isinstance(data.get("handles"), dict):
        raise InputError("expected a mapping `handles` with `static` and `moving`")
    handles = data["handles"]
    with naming("`handles`"):
        require_known(handles, ("static", "moving"))
    (static,) = _names(handles, "static", "positions")
    moving, transforms = _names(handles, "moving", "positions", "transform")
    if len(moving) != len(transforms):
        parts_have = counted(len(moving), "moving part has", "moving parts have")
        targets = counted(len(transforms), "transform", "transforms")
        raise InputError(f"{parts_have} {targets}; each needs one")
    if not static and not moving:
        raise InputError("there are no handles; name at least one static or moving part")
    parts, goals = path.parent / "parts", path.parent / "transforms"
    found: list[tuple[np.ndarray, np.ndarray | None]] = [(_read_points(parts, name), None) for name in static]
    for name, transform in zip(moving, transforms, strict=True):
        points, target = _read_points(parts, name), _read_points(goals, transform)
        if len(points) != len(target):
            k = counted(len(points), "point", "points")
            raise InputError(f"part {name} has {k}, its transform {transform} {len(target)}")
        found.append((points, target))
    return found


def _names(handles: dict[str, Any], kind: str, *keys: str) -> list[list[str]]:
    """Return the names at the keys of the parts of a kind."""
    parts = handles.get(kind) or {}
    with naming(f"`handles.{kind}`"):
        if not isinstance(parts, dict):
            raise InputError("it must be a mapping")
        require_known(parts, keys)
        found = [parts.get(key) or [] for key in keys]
        for key, names in zip(keys, found, strict=True):
            if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
                raise InputError(f"`{key}` must be a list of names")
    return found


def _read_points(folder: Path, name: str) -> np.ndarray:
    path = folder / f"{name}.txt"
    if not path.is_file():
        raise InputError(f"no such file: {path}")
    try:
        rows = [line.split() for line in decoded(path.read_bytes()).splitlines() if line.strip()]
        values = [[float(word) for word in row] for row in rows]
    except (ValueError, InputError) as error:
        raise InputError(f"{path}: each line needs three numbers ({error})") from error
    return as_points(values, str(path))

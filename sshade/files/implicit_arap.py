"""Read handle files of Implicit-ARAP: named parts, in its coordinates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sshade.core.atomic import naming
from sshade.core.errors import InputError, counted
from sshade.files.handwritten import as_points, decoded, parsed_yaml, require_known


def read_implicit_arap(path: Path) -> list[tuple[np.ndarray, np.ndarray | None]]:
    """Return the points of each part and their targets, None if the part is fixed, in the file's coordinates.

    D. Baieri, F. Maggioli, Z. Laehner, S. Melzi, E. Rodola, "Implicit-ARAP", 2024.
    """
    data = parsed_yaml(path.read_bytes())
    if not isinstance(data, dict) or not isinstance(data.get("handles"), dict):
        raise InputError("expected a mapping `handles` with `static` and `moving`")
    _check_keys(data["handles"])
    static = _names(data["handles"], "static", "positions")
    moving = _names(data["handles"], "moving", "positions")
    transforms = _names(data["handles"], "moving", "transform")
    if len(moving) != len(transforms):
        parts_have = counted(len(moving), "moving part has", "moving parts have")
        targets = counted(len(transforms), "transform", "transforms")
        raise InputError(f"{parts_have} {targets}; each needs one")
    if not static and not moving:
        raise InputError("there are no handles; name at least one static or moving part")
    parts: list[tuple[str, str | None]] = [(name, None) for name in static]
    parts += zip(moving, transforms, strict=True)
    found: list[tuple[np.ndarray, np.ndarray | None]] = []
    for name, transform in parts:
        points, target = _read_points(path.parent / "parts", name), None
        if transform is not None:
            target = _read_points(path.parent / "transforms", transform)
            if len(points) != len(target):
                raise InputError(
                    f"part {name} has {counted(len(points), 'point', 'points')}, its transform {transform} "
                    f"{len(target)}"
                )
        found.append((points, target))
    return found


def _check_keys(handles: dict[str, Any]) -> None:
    """Raise InputError if a key of the handles is unknown. Implicit-ARAP may read other keys of the file."""
    with naming("`handles`"):
        require_known(handles, ("static", "moving"))
    for kind, known in {"static": ("positions",), "moving": ("positions", "transform")}.items():
        if isinstance(handles.get(kind), dict):
            with naming(f"`handles.{kind}`"):
                require_known(handles[kind], known)


def _names(handles: dict, kind: str, key: str) -> list[str]:
    parts = handles.get(kind) or {}
    names = (parts.get(key) or []) if isinstance(parts, dict) else None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError(f"`handles.{kind}.{key}` must be a list of names")
    return names


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

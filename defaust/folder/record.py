"""Schemas of the JSON files in a DeFAUST folder, and their reader, which checks every file before use."""

from __future__ import annotations

import json
import os
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from defaust.folder.layout import DATASET, FORMAT, WORK, checksum
from defaust.schema import mismatch
from sshade import InputError

#: Measured facts of a mesh.
FACTS = {
    **dict.fromkeys(("vertices", "faces", "euler", "self_intersecting_faces"), int),
    **dict.fromkeys(("boundary_loops?", "components?"), int),
    "oriented_manifold?": bool,
    **dict.fromkeys(("area", "diagonal"), float),
    "volume": (float, None),
}
SUBJECT = {
    "subject": int,
    "landmark_vertices": {str: int},
    "left_out?": [{"pose": int, "name": str, "reason": str}],
    "dropped?": {str: int},
    # A pose has a registered mesh unless it says `registered: false`.
    "poses": [
        {
            "pose": int,
            "name": str,
            "static": int,
            "dynamic": int,
            "volume": (float, None),
            "registered?": bool,
            # Measures of the handles; see defaust.build.measures. Older builds lack them.
            "moving?": int,
            "static_moved?": (float, None),
            "groups?": [{"landmark": str, "residual": float, "turned": (float, None)}],
            "contradictions?": [{"static": str, "dynamic": str, "apart": float, "distance": float}],
        }
    ],
    "low": FACTS,
    "high": FACTS | {"ls3_steps": int, "edge_length": (float, None), "remeshings": int},
}
FILES = {str: {"sha256": str, "bytes": int, "vertices?": int, "faces?": int}}
#: A finished subject, as an unfinished build stores it.
FINISHED = SUBJECT | {"files": FILES}
#: Parameters of a build; see :class:`defaust.build.options.BuildOptions`.
BUILD = {
    "subjects": [int],
    **dict.fromkeys(("seed", "remesh_iterations", "handles_per_landmark", "neighbourhood"), int),
    **dict.fromkeys(("target_vertices", "ls3_steps"), (int, None)),
    "window": [float, float],
    "static_below": float,
}
#: dataset.json.
DOCUMENT = {
    "format": int,
    "source": {
        **dict.fromkeys(("name", "title", "origin", "licence", "citation", "axes", "unit", "note?"), str),
        **dict.fromkeys(("limits", "classes?", "without?"), [str]),
        **dict.fromkeys(("files?", "left_out?"), {str: str}),
    },
    "name": str,
    "build": BUILD,
    "tools": {str: str},
    "landmarks": [str],
    "poses": {str: [{"pose": int, "name": str, "aligned": (bool, None), "landmarks": [str]}]},
    "subjects": [SUBJECT],
    "left_out?": [{"subject": int, "reason": str}],
    "files": FILES,
    "checksum": str,
}
LANDMARK = {
    **dict.fromkeys(("landmark", "kind"), str),
    **dict.fromkeys(("delta", "delta_mean"), (float, None)),
}
#: Handles of a pose: each landmark has positions or is a region.
POSE = {
    "source_pose": str,
    "handles": [
        (
            LANDMARK | dict.fromkeys(("source", "target"), [[float, float, float]]),
            LANDMARK
            | {"boxes": [[[float, float, float], [float, float, float]]]}
            | {"rotation": [[float, float, float], [float, float, float], [float, float, float]]}
            | {"translation": [float, float, float]},
        )
    ],
}


def read_dataset(root: str | os.PathLike[str], *, intact: bool = True) -> dict[str, Any]:
    """Read dataset.json.

    Parameters
    ----------
    root : path
    intact : bool
        Refuse a record whose checksum does not match its content.

    Raises
    ------
    InputError
        When the folder is missing, is not a finished DeFAUST folder of this format, or its record is
        damaged or lists files outside the folder.
    """
    root = Path(root)
    path = root / DATASET
    if not root.is_dir():
        raise InputError(f"{root}: no such folder")
    if not path.is_file():
        hint = (
            "run the same defaust build again to continue it"
            if (root / WORK).is_dir()
            else f"if it holds your meshes, build a dataset from them: defaust build source=faust "
            f"source.root={root} out=DIR; use source=tosca or source=sequence for meshes other than FAUST's"
        )
        raise InputError(f"{root} is not a finished DeFAUST folder (it has no {DATASET}); {hint}")
    document = read_json(path)
    if not isinstance(document, dict) or "format" not in document:
        raise InputError(f"{path}: not a DeFAUST record")
    if document["format"] != FORMAT:
        raise InputError(f"{path}: format {document['format']} is not the supported {FORMAT}; rebuild it")
    _require(document, DOCUMENT, path)
    _check_subjects(document, path)
    if intact and checksum(document) != document["checksum"]:
        raise InputError(f"{path}: changed after the build; restore the file or build the dataset again")
    return document


def has_regions(document: dict[str, Any]) -> bool:
    """Whether the handles of a dataset are regions instead of positions near landmarks."""
    return not any(subject["landmark_vertices"] for subject in document["subjects"])


def read_record(path: Path, schema: dict[str, Any]) -> dict[str, Any]:
    """Read a JSON object, such as the handles of a pose (:data:`POSE`).

    Raises
    ------
    InputError
        When the file is not JSON, or does not match the schema.
    """
    record: dict[str, Any] = read_json(path)
    _require(record, schema, path)
    return record


def read_json(path: Path) -> Any:
    """Read a JSON file; raise InputError when it is not JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        why = "nested too deeply" if isinstance(error, RecursionError) else error
        raise InputError(f"{path}: not a readable JSON file ({why})") from error


def _require(record: Any, schema: dict[str, Any], path: Path) -> None:
    problem = mismatch(record, schema)
    if not problem:
        outside = [name for name in record.get("files", ()) if not _is_inside(name)]
        problem = f"it lists the file {outside[0]!r}, which is not inside the folder" if outside else ""
    if problem:
        raise InputError(f"{path}: damaged, {problem}; restore the file or build the dataset again")


def _is_inside(name: str) -> bool:
    """Whether a listed name stays inside the folder of the dataset."""
    path = PurePosixPath(name)
    return bool(path.parts) and ".." not in path.parts and not PureWindowsPath(name).anchor


def _check_subjects(document: dict[str, Any], path: Path) -> None:
    """Raise InputError unless all parts of a record name the same subjects."""
    numbers = [subject["subject"] for subject in document["subjects"]]
    left_out = [entry["subject"] for entry in document.get("left_out", ())]
    if not numbers or sorted(numbers + left_out) != document["build"]["subjects"]:
        raise InputError(f'{path}: damaged, "subjects" and "build.subjects" differ; restore the file')
    classes = document["source"].get("classes")
    for number in numbers:
        if str(number) not in document["poses"] or (classes is not None and not 0 <= number < len(classes)):
            raise InputError(
                f"{path}: damaged, poses or class of subject {number} are missing; restore the file"
            )

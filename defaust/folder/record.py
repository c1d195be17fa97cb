"""The record of a DeFAUST folder, dataset.json, and its reader.

The record holds its own checksum and the checksum of every file. Whoever reads a file compares the checksum
first, and then trusts the content.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from defaust.folder.layout import DATASET, FORMAT, WORK, checksum
from sshade import InputError


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
        When the folder is missing, or is not a finished DeFAUST folder of this format.
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
    if intact and checksum(document) != document.get("checksum"):
        raise InputError(f"{path}: changed after the build; restore the file or build the dataset again")
    return document


def has_regions(document: dict[str, Any]) -> bool:
    """Whether the handles of a dataset are regions instead of positions near landmarks."""
    return not any(subject["landmark_vertices"] for subject in document["subjects"])


def read_json(path: Path) -> Any:
    """Read a JSON file; raise InputError when it is not JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        why = "nested too deeply" if isinstance(error, RecursionError) else error
        raise InputError(f"{path}: not a readable JSON file ({why})") from error

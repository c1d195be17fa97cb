"""Names and records of a DeFAUST folder, shared by whoever writes or reads one."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

from defaust.folder.record import DOCUMENT, require, require_inside
from sshade import InputError
from sshade.io.files import replacing

FORMAT = 1
#: Inside a folder under construction: holds the records of finished subjects.
WORK = ".build"
DATASET = "dataset.json"
CARD = "README.md"
REST, REST_LOW = "rest.ply", "rest_low.ply"


def subject_folder(subject: int) -> str:
    """Folder of a subject inside the dataset."""
    return f"subject_{subject:02d}"


def pose_file(pose: int) -> str:
    """Handles of a pose, inside the subject's folder."""
    return f"pose_{pose}.json"


def pose_mesh(pose: int) -> str:
    """Registered target pose, inside the subject's folder."""
    return f"pose_{pose}_low.ply"


def sha256(path: Path) -> str:
    """Hexadecimal sha256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def dump(document: Any, *, indent: int | None = 1) -> str:
    """JSON text, the same for the same document."""
    return json.dumps(document, indent=indent, ensure_ascii=False, allow_nan=False) + "\n"


def write_text(path: Path, text: str) -> None:
    """Write a text file that appears whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def checksum(document: dict[str, Any]) -> str:
    """sha256 of a dataset's record without its own ``checksum`` entry."""
    rest = {key: value for key, value in document.items() if key != "checksum"}
    return hashlib.sha256(dump(rest).encode("utf-8")).hexdigest()


def read_dataset(root: str | os.PathLike[str], *, intact: bool = True) -> dict[str, Any]:
    """Read dataset.json.

    Parameters
    ----------
    root : path
    intact : bool
        Refuse a record that is not as the build left it, by its own checksum.

    Raises
    ------
    InputError
        When the folder is missing, is no finished DeFAUST folder of this format,
        or its record is damaged or leads out of the folder.
    """
    root = Path(root)
    path = root / DATASET
    if not root.is_dir():
        raise InputError(f"{root}: no such folder")
    if not path.is_file():
        hint = (
            "run the same defaust build again, which goes on"
            if (root / WORK).is_dir()
            else f"if it holds your meshes, make one of them: defaust build source=faust source.root={root} "
            "out=DIR, with source=tosca or source=sequence for meshes other than FAUST's"
        )
        raise InputError(f"{root} is not a finished DeFAUST folder (it has no {DATASET}); {hint}")
    document = read_json(path)
    if not isinstance(document, dict) or "format" not in document:
        raise InputError(f"{path}: not a DeFAUST record")
    if document["format"] != FORMAT:
        raise InputError(f"{path}: format {document['format']} is not the supported {FORMAT}; rebuild it")
    require(document, DOCUMENT, where=str(path))
    require_inside(document["files"], where=str(path))
    _check_classes(document, path)
    if intact and checksum(document) != document["checksum"]:
        raise InputError(f"{path}: it was changed after the build; restore it, or build the dataset again")
    return document


def _check_classes(document: dict[str, Any], path: Path) -> None:
    """Raise InputError where a subject has no class although there are classes, or poses are not all told."""
    classes = document["source"].get("classes")
    for subject in document["subjects"]:
        number = subject["subject"]
        if str(number) not in document["poses"] or (classes is not None and not 0 <= number < len(classes)):
            raise InputError(f"{path}: damaged, it does not say all of subject {number}; restore the file")


def read_json(path: Path) -> Any:
    """Read a JSON file; InputError when it is no JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except RecursionError as error:
        raise InputError(f"{path}: not a readable JSON file (nested too deeply)") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a readable JSON file ({error})") from error

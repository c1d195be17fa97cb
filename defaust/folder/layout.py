"""Names and checksums of the files in a DeFAUST folder."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from sshade.core.errors import InputError, reason
from sshade.core.whole_files import replacing

#: Version of the format of dataset.json.
FORMAT = 1
#: Folder inside a dataset under construction; holds the records of finished subjects.
WORK = ".build"
DATASET = "dataset.json"
CARD = "README.md"
#: Rest mesh at high resolution, and the registered rest mesh.
REST, REST_LOW = "rest.ply", "rest_low.ply"


def subject_folder(subject: int) -> str:
    """Folder of a subject inside the dataset."""
    return f"subject_{subject:02d}"


def pose_file(pose: int) -> str:
    """File of a pose's handles, inside the subject's folder."""
    return f"pose_{pose}.json"


def pose_mesh(pose: int) -> str:
    """File of the registered target pose, inside the subject's folder."""
    return f"pose_{pose}_low.ply"


def sha256(path: Path) -> str:
    """Hexadecimal sha256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def dump(document: Any, *, indent: int | None = 1) -> str:
    """JSON text of a document; equal documents give equal text."""
    return json.dumps(document, indent=indent, ensure_ascii=False, allow_nan=False) + "\n"


def make_folder(path: Path) -> None:
    """Create a folder and its parents unless they exist.

    Raises
    ------
    InputError
        When the folder cannot be created: a file is in its way, a parent is read-only, the disk is full.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: the folder cannot be created ({reason(error)})") from error


def write_text(path: Path, text: str) -> None:
    """Write a text file; on failure nothing is left at `path`."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def checksum(document: dict[str, Any]) -> str:
    """sha256 of a dataset's record, without its ``checksum`` entry."""
    rest = {key: value for key, value in document.items() if key != "checksum"}
    return hashlib.sha256(dump(rest).encode("utf-8")).hexdigest()

"""Numbered files of a sequence, with a record from which an interrupted sequence goes on.

The record lies beside the files: ``out_%04d.ply`` has ``out_sequence.json``. For each file it has a key,
which depends on all inputs of this pose and of the poses before, and a checksum of the file. Files whose key
and checksum agree need not be computed again.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np

from sshade.errors import InputError
from sshade.io.document import MeshFile
from sshade.io.files import replacing

_NUMBER = re.compile(r"%(0\d+)?d")


def has_number(path: Path) -> bool:
    """Whether a name has a place for a number, and raise InputError on two places, or one such as ``%4d``."""
    places = re.findall(r"%\d*d", path.name)
    if places and (len(places) > 1 or not _NUMBER.fullmatch(places[0])):
        raise InputError(f"{path}: a pattern has one place for the number, such as out_%04d.ply")
    return bool(places)


class NumberedFiles:
    """Files of a sequence, numbered from 1.

    Parameters
    ----------
    pattern : path
        With ``%d``, or ``%04d`` for four digits.
    keys : sequence of str
        Key of each file; see :func:`chained_keys`.

    Attributes
    ----------
    kept : int
        Number of first files that exist and belong to the keys.
    record : path
    """

    def __init__(self, pattern: Path, keys: Sequence[str]) -> None:
        self._pattern, self._keys = pattern, keys
        stem = _NUMBER.sub("", pattern.stem).rstrip("_-. ")
        self.record = pattern.with_name(f"{stem}_sequence.json" if stem else "sequence.json")
        self._entries: list[dict[str, str]] = []
        for number, entry in enumerate(self._read()[: len(keys)]):
            path = self.path(number)
            known = isinstance(entry, dict) and entry.get("key") == keys[number] and path.is_file()
            if not known or entry.get("checksum") != checksum(path):
                break
            self._entries.append(entry)
        self.kept = len(self._entries)

    def path(self, number: int) -> Path:
        """Return the path of a pose, counted from 0."""
        return self._pattern.with_name(
            _NUMBER.sub(lambda place: place.group() % (number + 1), self._pattern.name)
        )

    def write(self, file: MeshFile, V: np.ndarray) -> Path:
        """Write the next pose of a mesh file, at positions V (n, 3), and record it; return its path."""
        from sshade.io.meshes import write_file  # imports large libraries

        number = len(self._entries)
        path = self.path(number)
        write_file(path, file, V)
        self._entries.append({"file": path.name, "key": self._keys[number], "checksum": checksum(path)})
        text = ",\n".join(f"  {json.dumps(entry)}" for entry in self._entries)
        with replacing(self.record) as temporary:
            temporary.write_text(f'{{"sequence": [\n{text}\n]}}\n', encoding="utf-8")
        return path

    def _read(self) -> list[Any]:
        """Return the entries of the record; none if it is missing or damaged."""
        with suppress(OSError, ValueError):
            data = json.loads(self.record.read_bytes())
            if isinstance(data, dict) and isinstance(data.get("sequence"), list):
                return data["sequence"]
        return []


def chained_keys(inputs: str, poses: Iterable[bytes]) -> list[str]:
    """Return a key for each pose, which depends on the inputs and on this and all earlier poses.

    Parameters
    ----------
    inputs : str
        Everything else on which the results depend.
    poses : iterable of bytes
        Contents of each pose.
    """
    key, found = blake2b(inputs.encode()), []
    for pose in poses:
        key.update(pose)
        found.append(key.hexdigest()[:32])
    return found


def input_checksum(path: Path) -> str:
    """Return a checksum of a mesh file, with the buffers beside a glTF file."""
    from sshade.io.gltf import buffer_files  # imports large libraries

    return "".join(checksum(one) for one in (path, *buffer_files(path)))


def checksum(path: Path) -> str:
    """Return a checksum of the bytes of a file."""
    return blake2b(path.read_bytes()).hexdigest()[:32]

"""A small source of balls, whose builds take a second; and functions that damage datasets."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from defaust.build.options import BuildOptions
from defaust.folder.layout import checksum, dump, sha256
from defaust.sources.source import Source, SourcePose
from sshade import Mesh
from tests.shapes import icosphere

OPTIONS = BuildOptions(target_vertices=400, handles_per_landmark=6, neighbourhood=10)
#: Options of a build that keeps the registered resolution.
KEPT = replace(OPTIONS, target_vertices=None)


@dataclass(frozen=True)
class Balls(Source):
    """Balls with landmarks at the top, at the bottom, and at the front."""

    stretch: float = 1.0
    name: str = "balls"
    subjects: tuple[int, ...] = (0, 1, 2)
    landmark_names: tuple[str, ...] = ("top", "bottom", "front")

    @property
    def provenance(self) -> Mapping[str, object]:
        facts = dict.fromkeys(("title", "origin", "licence", "citation", "axes", "unit"), "balls")
        return {**facts, "limits": ["They are balls."], "stretch": self.stretch}

    def landmark_vertices(self, subject: int) -> Mapping[str, int]:
        V = self.rest(subject).V
        return {"top": int(V[:, 1].argmax()), "bottom": int(V[:, 1].argmin()), "front": int(V[:, 2].argmax())}

    def poses(self, subject: int) -> tuple[SourcePose, ...]:
        return (SourcePose("lean", ("top", "bottom")), SourcePose("turn", self.landmark_names, aligned=False))

    def rest(self, subject: int) -> Mesh:
        ball = icosphere(3)
        return Mesh(ball.V * [1.0, self.stretch + 0.1 * subject, 1.0], ball.F)

    def posed(self, subject: int, pose: SourcePose) -> Mesh:
        rest = self.rest(subject)
        if pose.name == "lean":
            return Mesh(rest.V + [1.0, 0, 0] * np.maximum(0.0, rest.V[:, 1:2]), rest.F)
        return Mesh(rest.V[:, [2, 1, 0]] * [1, 1, -1] + [3.0, 0.0, 0.0], rest.F)


def change(root: Path, edit: Callable[[dict[str, Any]], Any], *, sign: bool = True) -> None:
    """Edit dataset.json; `sign` updates its checksum."""
    path = root / "dataset.json"
    document = json.loads(path.read_text())
    edit(document)
    if sign:
        document["checksum"] = checksum(document)
    path.write_text(dump(document))


def relist(root: Path, name: str) -> None:
    """Update the checksum of a changed file in dataset.json."""
    entry = {"sha256": sha256(root / name), "bytes": (root / name).stat().st_size}
    change(root, lambda document: document["files"][name].update(entry))


def change_handles(root: Path, name: str, edit: Callable[[dict[str, Any]], Any]) -> None:
    """Edit a pose file, and update its checksum in dataset.json."""
    content = json.loads((root / name).read_text())
    edit(content)
    (root / name).write_text(dump(content))
    relist(root, name)


def flip_a_byte(path: Path, at: int = -5) -> None:
    """Flip a bit of a file."""
    data = bytearray(path.read_bytes())
    data[at] ^= 1
    path.write_bytes(data)

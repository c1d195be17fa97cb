"""Handles for any mesh: in each component, one end stays and the other end is turned and moved."""

from __future__ import annotations

import json
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from tools.corpus.case import SEED
from tools.corpus.document import Document
from tools.corpus.joints import Joints

#: Portions of the places of a component at each end: regions, or a few vertices. The name decides which.
PORTIONS = (0.15, 0.005)
#: Number of handles in all components together.
MOST = 2000
#: Motion of the moving end: its turn in degrees, and its way as a fraction of the component's extent.
TURN, WAY = 20.0, 0.06


@dataclass(frozen=True)
class Made:
    """Handles that were made for a mesh.

    Attributes
    ----------
    index : (k,) int64
    target : (k, 3) float64
    group : (k,) int64
        Even groups stay at rest.
    slope : (components,) float64
        The largest difference of the motions of two handles of a component, over their distance.
    complete : bool
        Whether the handle file holds no other handles.
    few : bool
        Whether the handles are a few vertices, and no regions.
    """

    index: np.ndarray
    target: np.ndarray
    group: np.ndarray
    slope: np.ndarray
    complete: bool = True
    few: bool = False

    def content(self, mesh: Document, file: Path) -> bytes:
        """Return the handle file. In glTF files, vertices have no ids; positions are given there."""
        entries: list[dict[str, Any]] = []
        for group in np.unique(self.group):
            here, fixed = self.group == group, group % 2 == 0
            entry = {"landmark": f"end {group}", "kind": "static" if fixed else "dynamic"}
            ids = self.index[here]
            positions = file.suffix.lower() in (".glb", ".gltf")
            entry |= {"source": mesh.V[ids].tolist()} if positions else {"vertices": ids.tolist()}
            entries.append(entry if fixed else entry | {"target": self.target[here].tolist()})
        return json.dumps({"handles": entries}).encode()


def made(mesh: Document, joints: Joints, name: str) -> Made:
    """Make handles; the same for the same mesh and name."""
    number_of_name = zlib.crc32(name.encode())
    random, portion = np.random.default_rng([SEED, number_of_name]), PORTIONS[number_of_name % len(PORTIONS)]
    place, component = joints.place, joints.component
    count = int(component.max(initial=-1)) + 1
    shared = _of_several_components(place, component)
    index, target, group = [[np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))], [np.zeros(0, dtype=np.int64)]]
    slope = np.zeros(count)
    for number in range(count):
        members = np.flatnonzero((component == number) & ~shared[place])
        places, first = np.unique(place[members], return_index=True)
        points = mesh.V[members[first]]
        if not len(points):
            continue
        axis = int(np.ptp(points, axis=0).argmax())
        order = np.argsort(points[:, axis], kind="stable")
        size = max(1, min(round(portion * len(order)), MOST // (2 * count)))
        fixed, moved = order[:size], order[size:][-size:]
        R = Rotation.from_rotvec(np.radians(TURN) * _direction(random)).as_matrix()
        center = points[moved].mean(axis=0) if len(moved) else np.zeros(3)
        shift = center + WAY * np.ptp(points[:, axis]) * _direction(random)
        for k, end in enumerate((fixed, moved)):
            here = members[np.isin(place[members], places[end])]
            index.append(here)
            target.append((mesh.V[here] - center) @ R.T + shift if k else mesh.V[here])
            group.append(np.full(len(here), 2 * number + k))
        if len(moved):
            motion = (points[moved] - center) @ R.T + shift - points[moved]
            distance = cdist(points[fixed], points[moved]).min(axis=0)
            slope[number] = (np.linalg.norm(motion, axis=1) / distance).max()
    few = portion == min(PORTIONS)
    return Made(np.concatenate(index), np.concatenate(target), np.concatenate(group), slope, few=few)


def _of_several_components(place: np.ndarray, component: np.ndarray) -> np.ndarray:
    """Return for each place whether it belongs to several components."""
    used = component >= 0
    pairs = np.unique(np.stack([place[used], component[used]]), axis=1)
    return np.bincount(pairs[0], minlength=place.max(initial=0) + 1) > 1


def _direction(random: np.random.Generator) -> np.ndarray:
    vector = random.normal(size=3)
    return vector / np.linalg.norm(vector)

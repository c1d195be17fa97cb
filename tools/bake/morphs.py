"""Read MakeHuman's base mesh, morph targets, joints and weights (the CC0 files only)."""

from __future__ import annotations

import gzip
import itertools
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

#: Shapes of the subjects, and poses.
PARAMETERS = yaml.safe_load(Path(__file__).with_name("bake.yaml").read_text(encoding="utf-8"))
#: Unit of the files (decimetres) in metres.
METRES = 0.1
#: Parameter values at which a target has full weight.
AGES = {"baby": 0.0, "child": 0.1875, "young": 0.5, "old": 1.0}
AMOUNTS = {"min": 0.0, "average": 0.5, "max": 1.0}

#: Bones of the asset, parents first. Fingers follow the hand.
BONES = (
    *("Root", "pelvis", "spine_01", "spine_02", "spine_03", "neck_01", "head"),
    *("clavicle_l", "upperarm_l", "lowerarm_l", "hand_l", "clavicle_r", "upperarm_r", "lowerarm_r", "hand_r"),
    *("thigh_l", "calf_l", "foot_l", "ball_l", "thigh_r", "calf_r", "foot_r", "ball_r"),
)


@dataclass(frozen=True)
class Shape:
    """Parameters of a body, each in [0, 1].

    Gender 1 is male. Age 0.5 is a young adult, 1 an old adult. Height and proportions have no effect at 0.5.
    `race` holds the weights of African, Asian and Caucasian.
    """

    gender: float = 0.5
    age: float = 0.5
    muscle: float = 0.5
    weight: float = 0.5
    height: float = 0.5
    proportions: float = 0.5
    race: tuple[float, float, float] = (1 / 3, 1 / 3, 1 / 3)


@dataclass(frozen=True)
class BaseMesh:
    """Base mesh with its helper geometry.

    Attributes
    ----------
    V : (n, 3) float64
        Positions of body and helpers, in metres.
    F : (m, 3) int64
        Faces of the body.
    groups : dict
        Vertex ids of each group; the body is the group ``body``.
    """

    V: np.ndarray
    F: np.ndarray
    groups: dict[str, np.ndarray]


def read_base(root: Path) -> BaseMesh:
    """Read ``3dobjs/base.obj`` and split quads along the shorter diagonal."""
    positions, polygons, group = [], {}, ""
    for line in (root / "3dobjs" / "base.obj").read_text(encoding="utf-8").splitlines():
        word, _, rest = line.partition(" ")
        if word == "v":
            positions.append([float(x) for x in rest.split()])
        elif word == "g":
            group = rest.strip()
        elif word == "f":
            polygons.setdefault(group, []).append([int(c.split("/")[0]) - 1 for c in rest.split()])
    V = METRES * np.array(positions)
    groups = {name: np.unique(np.concatenate(faces)) for name, faces in polygons.items()}
    a, b, c, d = np.array(polygons["body"]).T
    first = np.linalg.norm(V[a] - V[c], axis=1) <= np.linalg.norm(V[b] - V[d], axis=1)
    by_ac = np.stack([a, b, c, a, c, d], axis=1)
    by_bd = np.stack([a, b, d, b, c, d], axis=1)
    F = np.where(first[:, None], by_ac, by_bd).reshape(-1, 3)
    return BaseMesh(V, F.astype(np.int64), groups)


def morph(root: Path, base: BaseMesh, *, shape: Shape) -> np.ndarray:
    """Morph the base mesh, helpers included; return its vertices (n, 3).

    A target's weight is the product of piecewise-linear weights of the parameters in its name.
    """
    folder = root / "targets" / "macrodetails"
    genders = {"female": 1.0 - shape.gender, "male": shape.gender}
    ages = _hat(AGES, shape.age)
    muscles = {f"{k}muscle": w for k, w in _hat(AMOUNTS, shape.muscle).items()}
    weights = {f"{k}weight": w for k, w in _hat(AMOUNTS, shape.weight).items()}
    heights = _two_sided(shape.height, "minheight", "maxheight")
    proportions = _two_sided(shape.proportions, "uncommonproportions", "idealproportions")
    races = dict(zip(("african", "asian", "caucasian"), shape.race, strict=True))
    body = (genders, ages, muscles, weights)

    V = base.V.copy()
    for factors, prefix in (
        ((races, genders, ages), ""),
        (body, "universal-"),
        ((*body, heights), "height/"),
        ((*body, proportions), "proportions/"),
    ):
        for names in itertools.product(*factors):
            weight = np.prod([factor[name] for factor, name in zip(factors, names, strict=True)])
            if weight > 0:
                ids, offsets = _read_target(folder / f"{prefix}{'-'.join(names)}.target.gz")
                V[ids] += weight * METRES * offsets
    return V


def read_joints(root: Path, base: BaseMesh) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Vertex ids whose means are the head and the tail of each bone of the game rig."""

    def ids(end: dict[str, Any]) -> np.ndarray:
        if end["strategy"] == "CUBE":
            return base.groups[end["cube_name"]]
        return np.array(end["vertex_indices"])

    return {name: (ids(bone["head"]), ids(bone["tail"])) for name, bone in _read_rig(root, "rig").items()}


def read_parents(root: Path) -> np.ndarray:
    """Parent (b,) of each bone of :data:`BONES`, -1 at the root."""
    rig = _read_rig(root, "rig")
    parents = [rig[name]["parent"] for name in BONES]
    return np.array([BONES.index(parent) if parent else -1 for parent in parents])


def read_weights(root: Path, n: int) -> np.ndarray:
    """Skinning weights (n, b) of :data:`BONES`; the hand has the weights of its fingers."""
    W = np.zeros((n, len(BONES)))
    for name, pairs in _read_rig(root, "weights")["weights"].items():
        bone = name if name in BONES else f"hand_{name[-1]}"
        for vertex, weight in pairs:
            W[int(vertex), BONES.index(bone)] += weight
    return W / np.maximum(W.sum(axis=1, keepdims=True), 1e-12)


def _read_rig(root: Path, part: str) -> dict[str, Any]:
    path = root / "rigs" / "standard" / f"{part}.game_engine.json"
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return content


def _hat(anchors: dict[str, float], value: float) -> dict[str, float]:
    """Weights of linear interpolation between anchors; their sum is 1."""
    at = np.array(list(anchors.values()))
    return {name: float(np.interp(value, at, np.eye(len(at))[i])) for i, name in enumerate(anchors)}


def _two_sided(value: float, low: str, high: str) -> dict[str, float]:
    return {low: max(0.0, 1.0 - 2.0 * value), high: max(0.0, 2.0 * value - 1.0)}


def _read_target(path: Path) -> tuple[np.ndarray, np.ndarray]:
    with gzip.open(path, "rt", encoding="utf-8") as file:
        rows = np.array([line.split() for line in file if line.strip() and line[0] != "#"], dtype=float)
    rows = rows.reshape(-1, 4)  # a target may be empty
    return rows[:, 0].astype(np.int64), rows[:, 1:]

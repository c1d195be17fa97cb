"""Motions of the nodes of a glTF file: rigid or affine maps of the scene, at equal steps of time.

Khronos Group, "glTF 2.0 specification", 2021, section 3.11 and appendix C.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from sshade.errors import InputError
from sshade.io.files import expecting
from sshade.io.gltf import parsed_gltf
from sshade.io.gltf_scene import Gltf, ancestors, node_matrix, parents

#: Properties of a node that move it, and their numbers of components.
_PATHS = {"translation": 3, "rotation": 4, "scale": 3}
_REST = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}
#: Number of names in a message.
_SHOWN = 6


class Channel(NamedTuple):
    """A curve of one property of a node.

    Attributes
    ----------
    times : (k,) float64
        Increasing.
    values : (k, w) float64, or (k, 3, w) with tangents before and behind each value
    interpolation : {"LINEAR", "STEP", "CUBICSPLINE"}
    """

    times: np.ndarray
    values: np.ndarray
    interpolation: str

    def at(self, t: np.ndarray, *, rotation: bool) -> np.ndarray:
        """Return the values (j, w) at times t (j,); the first and last value hold outside of the keys."""
        times, values = self.times, self.values
        t = np.clip(t, times[0], times[-1])
        first = np.clip(np.searchsorted(times, t, side="right") - 1, 0, max(len(times) - 2, 0))
        if self.interpolation == "STEP":
            return values[np.searchsorted(times, t, side="right") - 1]
        if len(times) == 1:
            return np.repeat(values[:, 1] if values.ndim == 3 else values, len(t), axis=0)
        if self.interpolation == "LINEAR":
            if rotation:
                return Slerp(times, Rotation.from_quat(values))(t).as_quat()
            return np.stack([np.interp(t, times, column) for column in values.T], axis=1)
        length = (times[first + 1] - times[first])[:, None]
        s = (t - times[first])[:, None] / length
        _, v0, out = np.moveaxis(values[first], 1, 0)
        into, v1, _ = np.moveaxis(values[first + 1], 1, 0)
        found = (2 * s**3 - 3 * s**2 + 1) * v0 + (s**3 - 2 * s**2 + s) * length * out
        return found + (3 * s**2 - 2 * s**3) * v1 + (s**3 - s**2) * length * into


class NodeMotions(NamedTuple):
    """How the nodes of a file with some names move.

    Attributes
    ----------
    times : (k,) float64
        In seconds.
    maps : dict of (k, 4, 4) float64
        For each name the affine map of the scene that moves the node from rest to its place at each time.
    animation : str
        Name of the animation that is used.
    others : int
        Number of further animations in the file.
    """

    times: np.ndarray
    maps: dict[str, np.ndarray]
    animation: str
    others: int


def read_node_motions(path: Path, names: Sequence[str], *, fps: float) -> NodeMotions:
    """Read how nodes move in the first animation of a .glb or .gltf file.

    A node is at rest where its translation, rotation and scale put it without the animation.

    Parameters
    ----------
    path : path
    names : sequence of str
        Names of the nodes; nodes that the file lacks are left out.
    fps : float
        Samples per second, from the first to the last key of the animation.

    Raises
    ------
    InputError
        When the file cannot be read, has no animation, lacks nodes with these names, or moves none of them.
    """
    with expecting(f"a readable {path.suffix[1:].upper()} file", path):
        return _motions(parsed_gltf(path.read_bytes(), path), path, names, fps)


def _motions(gltf: Gltf, path: Path, names: Sequence[str], fps: float) -> NodeMotions:
    nodes, animations = gltf.tree.get("nodes", []), gltf.tree.get("animations", [])
    if not animations:
        raise InputError(f"{path}: it holds no animation")
    found = [(number, node["name"]) for number, node in enumerate(nodes) if node.get("name") in set(names)]
    if not found:
        there = [str(node["name"]) for node in nodes if "name" in node]
        raise InputError(
            f"{path}: no node has the name of a group of handles; the nodes are {_listed(there)}, the groups "
            f"{_listed(list(names))}"
        )
    twice = [name for _, name in found if [other for _, other in found].count(name) > 1]
    if twice:
        raise InputError(f"{path}: {len(twice)} nodes have the name {twice[0]!r}, which one group has")
    channels = _channels(gltf, animations[0])
    chains = {name: ancestors(number, parents(nodes)) for number, name in found}
    moving = [
        curve for chain in chains.values() for node in chain for curve in channels.get(node, {}).values()
    ]
    if not moving:
        raise InputError(f"{path}: its animation moves no node with the name of a group")
    begin, end = min(one.times[0] for one in moving), max(one.times[-1] for one in moving)
    times = begin + np.arange(int(np.floor((end - begin) * fps + 1e-6)) + 1) / fps
    maps = {}
    for name, chain in chains.items():
        now, rest = np.tile(np.eye(4), (len(times), 1, 1)), np.eye(4)
        for node in reversed(chain):  # from the root
            now = now @ _placed(nodes[node], channels.get(node, {}), times)
            rest = rest @ node_matrix(nodes[node])
        if not abs(np.linalg.det(rest[:3, :3])) > 0:
            raise InputError(f"{path}: the node {name!r} has no size at rest, so its motion is unknown")
        maps[name] = now @ np.linalg.inv(rest)
    title = str(animations[0].get("name", "the first"))
    return NodeMotions(times, maps, title, len(animations) - 1)


def _channels(gltf: Gltf, animation: dict[str, Any]) -> dict[int, dict[str, Channel]]:
    """Return the curves of each node by property."""
    found: dict[int, dict[str, Channel]] = {}
    for channel in animation["channels"]:
        target = channel["target"]
        if "node" not in target or target["path"] not in _PATHS:
            continue  # weights of morph targets, and extensions
        sampler, width = animation["samplers"][channel["sampler"]], _PATHS[target["path"]]
        times = gltf.dense(sampler["input"])[:, 0].astype(np.float64)
        kind = sampler.get("interpolation", "LINEAR")
        shape = (len(times), 3, width) if kind == "CUBICSPLINE" else (len(times), width)
        values = gltf.fractions(sampler["output"]).reshape(shape)
        if kind not in ("LINEAR", "STEP", "CUBICSPLINE"):
            raise ValueError(f"its interpolation {kind} is unknown")
        if not (np.isfinite(times).all() and (np.diff(times) > 0).all()):
            raise ValueError("the times of its animation do not increase")
        if not np.isfinite(values).all():
            raise ValueError("its animation has a value that is not finite")
        found.setdefault(target["node"], {})[target["path"]] = Channel(times, values, kind)
    return found


def _placed(node: dict[str, Any], curves: dict[str, Channel], times: np.ndarray) -> np.ndarray:
    """Return the matrices (k, 4, 4) that map a node to its parent at each time."""
    if not curves:
        return np.tile(node_matrix(node), (len(times), 1, 1))
    values = {}
    for path, rest in _REST.items():
        if path in curves:
            values[path] = curves[path].at(times, rotation=path == "rotation")
        else:
            values[path] = np.tile(np.array(node.get(path, rest), dtype=np.float64), (len(times), 1))
    found = np.tile(np.eye(4), (len(times), 1, 1))
    turned = Rotation.from_quat(values["rotation"]).as_matrix()
    found[:, :3, :3] = turned * values["scale"][:, None, :]
    found[:, :3, 3] = values["translation"]
    return found


def _listed(names: list[str]) -> str:
    """Return the first names for a message."""
    shown = ", ".join(repr(name) for name in names[:_SHOWN]) or "without names"
    return f"{shown} and {len(names) - _SHOWN} more" if len(names) > _SHOWN else shown

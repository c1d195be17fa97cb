"""Write a sequence of poses as one glTF file: morph targets, and an animation of their weights.

Targets hold displacements from the rest shape, as float32: of positions, and of normals and tangents if the
file has them. At the time of a pose its target has weight 1 and all others have 0; in between, viewers blend
two poses. All other contents of a glTF input stay.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sshade.core.errors import InputError, counted
from sshade.core.whole_files import replacing
from sshade.files.gltf import gltf_bytes, parsed_gltf, plain_gltf
from sshade.files.gltf_scene import CHANGED, Gltf, NewAccessors, bounds, mesh_matrices
from sshade.files.mesh_file import MeshFile, as_floats

#: Largest size of a file in bytes: lengths are 32-bit numbers. Some bytes are left for the JSON.
LARGEST = 2**32 - 2**26


def write_morphs(
    path: Path, file: MeshFile, poses: Iterable[np.ndarray], times: np.ndarray, names: Sequence[str]
) -> None:
    """Write poses of a mesh file as a .glb or .gltf with morph targets; it appears whole or not at all.

    Parameters
    ----------
    path : path
    file : MeshFile
        At rest.
    poses : iterable of (n, 3) float64
        Positions in the order of ``file.V``, one array for each time.
    times : (k,) float64
        In seconds, increasing; the first is not negative.
    names : sequence of str
        Name of each pose, which its target gets.

    Raises
    ------
    InputError
        When the file cannot be written, or its size would exceed the format's limit.
    """

    def content(V: np.ndarray) -> Gltf:
        as_floats(V, path)
        data = file.content(V, path) if path.suffix.lower() in file.suffixes else plain_gltf(path, V, file.F)
        return parsed_gltf(bytes(data), path)

    rest = content(file.V)
    new = rest._replace(buffers=[bytearray(data) for data in rest.buffers])
    tree, shown = new.tree, sorted(mesh_matrices(new.tree))
    primitives = [primitive for number in shown for primitive in tree["meshes"][number]["primitives"]]
    #: Accessors that change, and their rest values; tangents without their handedness.
    changing = {number: _vectors(rest, number) for p in primitives for number in _changed(p).values()}
    _require_room(path, rest, sum(values.nbytes for values in changing.values()), len(times))
    added = NewAccessors(new)
    #: Accessor of the displacements for each accessor that changes, for each pose.
    targets: list[dict[int, int]] = []
    with replacing(path) as temporary:
        for V in poses:
            pose, target = content(V), {}
            for number, values in changing.items():
                moves = _vectors(pose, number) - values
                target[number] = added.add(moves, bounds(moves))
            targets.append(target)
        for primitive in primitives:
            changed = _changed(primitive).items()
            primitive["targets"] = [{name: target[number] for name, number in changed} for target in targets]
        for number in shown:
            mesh = tree["meshes"][number]
            mesh["weights"] = [0.0] * len(targets)
            mesh["extras"] = {**mesh.get("extras", {}), "targetNames": list(names)}
        nodes = [number for number, node in enumerate(tree["nodes"]) if node.get("mesh") in shown]
        tree.setdefault("animations", []).append(_animation(added, nodes, times))
        added.close()
        temporary.write_bytes(gltf_bytes(new, path))


def _require_room(path: Path, rest: Gltf, bytes_a_pose: int, poses: int) -> None:
    """Raise InputError if the file would exceed the largest size."""
    size = sum(map(len, rest.buffers)) + poses * bytes_a_pose
    if size > LARGEST:
        take = counted(poses, "pose takes", "poses take")
        raise InputError(
            f"{path}: {take} {size / 1e9:.1f} GB, and a glTF file holds {LARGEST / 1e9:.1f}; "
            "write a file for each pose"
        )


def _animation(added: NewAccessors, nodes: list[int], times: np.ndarray) -> dict[str, Any]:
    """Return an animation in which some nodes show pose k at time k of `times` (k,)."""
    seconds = times.astype(np.float32)[:, None]
    clock = added.add(seconds, bounds(seconds), target=None)
    weights = added.add(np.eye(len(times), dtype=np.float32).reshape(-1, 1), target=None)
    channels = [{"sampler": 0, "target": {"node": node, "path": "weights"}} for node in nodes]
    sampler = {"input": clock, "output": weights, "interpolation": "LINEAR"}
    return {"name": "sequence", "channels": channels, "samplers": [sampler]}


def _vectors(gltf: Gltf, number: int) -> np.ndarray:
    """Return the first three numbers of each element of an accessor, as a copy (k, 3) float32."""
    return gltf.array(number)[:, :3].astype(np.float32)


def _changed(primitive: dict[str, Any]) -> dict[str, int]:
    """Return the accessors of a primitive that follow a deformation, by their names."""
    return {name: number for name, number in primitive["attributes"].items() if name in CHANGED}

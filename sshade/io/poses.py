"""Poses of a sequence: several handle files, an animation of handles, or the nodes of a glTF file.

An animation is a handle file (:mod:`sshade.io.handles`) with a list of frames::

    {"handles": [
        {"landmark": "foot", "vertices": [12, 13, 14]},
        {"landmark": "hand", "vertices": [40, 41]}],
     "frames": [
        {"time": 0.0, "handles": [{"landmark": "hand", "target": [[x, y, z], [x, y, z]]}]},
        {"time": 0.5, "handles": [{"landmark": "hand", "rotation": [x, y, z, w], "center": "centroid"}]}]}

``handles`` says where the groups are. Each frame has a ``time`` in seconds, larger than the time before, and
the motions of some groups: ``target``, or ``rotation``, ``translation`` and ``center``. A motion takes the
place of the motion in ``handles``, which applies to all other groups.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sshade.errors import InputError
from sshade.io.document import MORPHS, check_input
from sshade.io.entries import FRAMES, Entry, HandleFile, checked_entry, handle_file_of, read_handle_file
from sshade.io.files import naming
from sshade.io.keys import parsed_list, require_known
from sshade.io.regions import RigidMotion

if TYPE_CHECKING:
    from sshade.handles import Handles
    from sshade.mesh.surface import Surface

#: Keys of a motion, of a frame, and of a group in a frame.
MOTION = ("target", "rotation", "translation", "center")
FRAME, GROUP = ("time", "handles"), ("landmark", *MOTION)


class Pose(NamedTuple):
    """A pose of a sequence.

    Attributes
    ----------
    name : str
        File, or file and frame, for messages.
    file : HandleFile
    """

    name: str
    file: HandleFile

    def on(self, whole: Surface) -> Handles:
        """Place the handles of the pose on a surface; see :func:`sshade.io.handles.on_mesh`.

        Raises
        ------
        InputError
            When the handles do not fit the mesh. The message names the pose.
        """
        from sshade.io.handles import on_surface  # imports large libraries

        with naming(self.name):
            return on_surface(self.file, whole)


class Poses(NamedTuple):
    """The poses of a sequence.

    Attributes
    ----------
    poses : list of Pose
    times : (k,) float64
        In seconds, increasing.
    notes : list of str
        What the user should know about the files.
    """

    poses: list[Pose]
    times: np.ndarray
    notes: list[str]

    def on(self, whole: Surface) -> list[Handles]:
        """Place the handles of all poses on a surface.

        Raises
        ------
        InputError
            When handles do not fit the mesh, or differ between poses. The message names the pose.
        """
        placed = []
        for pose in self.poses:
            placed.append(pose.on(whole))
            with naming(pose.name):
                placed[-1].require_same(placed[0])
        return placed


def is_animation(path: Path) -> bool:
    """Whether a handle file has frames."""
    if path.suffix.lower() != ".json" or not path.is_file():
        return False
    content = path.read_bytes()
    # UTF-16 and UTF-32 have zeros between the letters.
    return f'"{FRAMES}"'.encode() in content.replace(b"\0", b"") and FRAMES in _parsed(path, content)


def read_poses(
    paths: Sequence[Path], *, animation: Path | None = None, raw: bool = False, fps: float
) -> Poses:
    """Read all poses of a sequence, and check them as far as this is possible without the mesh.

    Parameters
    ----------
    paths : sequence of path
        Several handle files, one animation of handles, or one handle file beside `animation`.
    animation : path, optional
        A .glb or .gltf file whose nodes move the groups of the same names.
    raw : bool
        See :func:`sshade.io.handles.read_handles`.
    fps : float
        Samples per second of the nodes, or poses per second of handle files.

    Raises
    ------
    InputError
        When a file cannot be read, frames are inconsistent, several files include an animation, or no node
        has the name of a group.
    """
    if animation is not None:
        if len(paths) > 1:
            raise InputError(f"{animation} moves the groups of one handle file; {len(paths)} are given")
        return _of_nodes(paths[0], animation, raw, fps)
    if len(paths) == 1 and is_animation(paths[0]):
        return poses_of(_parsed(paths[0], paths[0].read_bytes()), paths[0], raw=raw)
    poses = [Pose(str(path), read_handle_file(path, raw=raw)) for path in paths]
    return Poses(poses, np.arange(len(poses)) / fps, [])


def _moved_by(entry: Entry, M: np.ndarray | None) -> Entry:
    """Return a group that the map M (4, 4) of a node moves, or the same group without one."""
    if M is None:
        return entry
    A = M[:3, :3]
    U, _, W = np.linalg.svd(A)
    return entry._replace(motion=RigidMotion(A, M[:3, 3], np.zeros(3)), rotation=U @ W @ entry.rotation)


def _of_nodes(path: Path, animation: Path, raw: bool, fps: float) -> Poses:
    from sshade.io.gltf_animation import read_node_motions  # imports large libraries

    check_input(animation, MORPHS)
    file = read_handle_file(path, raw=raw)
    number = _numbers(file)
    motions = read_node_motions(animation, list(number), fps=fps)
    with naming(path):
        for name in motions.maps:
            _require_one(file, name)
    poses = []
    for frame, time in enumerate(motions.times):
        maps = {number[name]: M[frame] for name, M in motions.maps.items()}
        entries = [_moved_by(entry, maps.get(entry.number)) for entry in file.entries]
        poses.append(Pose(f"{animation}, {time:.3f} s", file._replace(entries=entries)))
    rest = np.eye(4)
    notes, still = [], [name for name in number if np.allclose(motions.maps.get(name, rest), rest)]
    if motions.others:
        notes.append(
            f"{animation}: the animation {motions.animation!r} is used, and {motions.others} are not"
        )
    if still:
        notes.append(
            f"no node of {animation} moves {', '.join(still)}: the motion of such a group is constant"
        )
    return Poses(poses, motions.times, notes)


def _parsed(path: Path, content: bytes) -> dict[str, Any]:
    with naming(path):
        return parsed_list(content, "handles")


def poses_of(data: dict[str, Any], path: Path, *, raw: bool = False) -> Poses:
    """Return the poses of an animation of handles, which was read as JSON from `path`.

    Raises
    ------
    InputError
        When frames are inconsistent. The message names `path`.
    """
    frames, data = data[FRAMES], {key: value for key, value in data.items() if key != FRAMES}
    with naming(path):
        if not isinstance(frames, list) or not frames:
            raise InputError(f'"{FRAMES}" must be a list of frames, at least one')
        base = handle_file_of(data, raw=raw)
        poses: list[Pose] = []
        times: list[float] = []
        for number, frame in enumerate(frames):
            with naming(f"frame {number}"):
                times.append(_time(frame, times))
                poses.append(Pose(f"{path}: frame {number}", _moved(base, data["handles"], frame, raw)))
    return Poses(poses, np.array(times), [])


def _time(frame: Any, before: list[float]) -> float:
    """Return the time of a frame, and check its keys."""
    if not isinstance(frame, dict):
        raise InputError("it is no JSON object")
    require_known(frame, FRAME)
    time = frame.get("time")
    if isinstance(time, bool) or not isinstance(time, int | float) or not math.isfinite(time) or time < 0:
        raise InputError('it needs a "time" in seconds, a number from 0')
    if before and not time > before[-1]:
        raise InputError(f"its time {time:g} is not larger than the time before, {before[-1]:g}")
    if not isinstance(frame.get("handles", []), list):
        raise InputError('"handles" must be a list of groups')
    return float(time)


def _numbers(file: HandleFile) -> dict[str, int]:
    """Return the number of the entry of each name."""
    return {entry.name: entry.number for entry in file.entries if entry.name}


def _require_one(file: HandleFile, name: str) -> None:
    """Raise InputError if several groups have a name that is to be moved."""
    if (count := sum(entry.name == name for entry in file.entries)) > 1:
        raise InputError(f'{count} groups have the name "{name}", which is moved; give each its own name')


def _moved(base: HandleFile, entries: list[Any], frame: dict[str, Any], raw: bool) -> HandleFile:
    """Return the handles of a frame: those of the file, with the motions of the frame."""
    number, moved = _numbers(base), {}
    for group in frame.get("handles", []):
        if not isinstance(group, dict) or "landmark" not in group:
            raise InputError('each of its "handles" must be an object with a "landmark"')
        require_known(group, GROUP)
        name = str(group["landmark"])
        if name not in number:
            raise InputError(
                f'there is no group "{name}"; the groups are {", ".join(number) or "without names"}'
            )
        _require_one(base, name)
        if number[name] in moved:
            raise InputError(f'the group "{name}" occurs twice')
        entry = {key: value for key, value in entries[number[name]].items() if key not in MOTION}
        if entry.get("kind") == "static":
            del entry["kind"]
        with naming(f'group "{name}"'):
            moved[number[name]] = checked_entry(number[name], {**entry, **group}, raw=raw)
    return base._replace(entries=[moved.get(one.number) or one for one in base.entries])

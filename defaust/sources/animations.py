"""Animation files ``.anime``, of DeformingThings4D: one list of triangles, and the vertices in every frame.

Little-endian, without padding: three int32, the numbers of frames nf, vertices nv and triangles nt; then
float32 (nv, 3), the vertices in the first frame; int32 (nt, 3), the triangles; float32
(nf - 1, nv, 3), how far the vertices are in each later frame from where they are in the first.

References
----------
Y. Li et al., "4DComplete: Non-Rigid Motion Estimation Beyond the Observable Surface", 2021.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from sshade import InputError
from sshade.mesh.rigid import rigid_motion

SUFFIX = ".anime"
#: Bytes of the three counts, and of three numbers: a point, an offset or a triangle.
_COUNTS, _TRIPLE = 12, 12
#: Frames nearer to each other (x diagonal of the rest frame) are the same pose.
SAME = 1e-3
#: Points that frames are told apart by: evenly many of the vertices.
_POINTS = 2000


class Counts(NamedTuple):
    """Numbers of frames, vertices and triangles."""

    frames: int
    vertices: int
    triangles: int

    @property
    def size(self) -> int:
        """Bytes of the whole file."""
        return _COUNTS + _TRIPLE * (self.frames * self.vertices + self.triangles)


def read_counts(path: Path) -> Counts:
    """Read the counts of a file, which must be as long as they say.

    Raises
    ------
    InputError
        When a count is less than 1, or the file is shorter or longer.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            counts = Counts(*np.frombuffer(file.read(_COUNTS), dtype="<i4").tolist())
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"{path}: not readable as {SUFFIX} ({_reason(error)})") from error
    if min(counts) < 1:
        said = f"{counts.frames} frames, {counts.vertices} vertices and {counts.triangles} triangles"
        raise InputError(f"{path}: not a {SUFFIX} file, it would have {said}")
    if size != counts.size:
        raise InputError(
            f"{path}: has {size:,} bytes, but {counts.frames:,} frames of {counts.vertices:,} vertices with "
            f"{counts.triangles:,} triangles take {counts.size:,}; it is cut off, or no {SUFFIX} file"
        )
    return counts


def read_frame(path: Path, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Read one frame.

    Parameters
    ----------
    path : Path
    number : int
        From 0.

    Returns
    -------
    V : (n, 3) float64
    F : (m, 3) int64
        As they stand in the file, not validated.

    Raises
    ------
    InputError
        As :func:`read_counts`, or when there is no such frame.
    """
    counts, first, F, offsets = _mapped(path)
    if not 0 <= number < counts.frames:
        raise InputError(f"{path}: has no frame {number}, they are 0 to {counts.frames - 1}")
    V = first.astype(np.float64)
    return (V if number == 0 else V + offsets[number - 1]), F.astype(np.int64)


def far_frames(path: Path, *, rest: int, count: int) -> list[int]:
    """Choose frames that differ from one another: each is the farthest from those before it and from `rest`.

    The distance of two frames is the root mean square of that of their vertices, after the best rigid
    motion: a walk through the scene is no other pose. Of large meshes every so many vertices count.

    Parameters
    ----------
    path : Path
    rest : int
        The rest frame, which is not chosen.
    count : int
        How many, at most; fewer where the others are nearer than :data:`SAME` to one of them.

    Returns
    -------
    list of int
        In their order in time.

    Raises
    ------
    InputError
        As :func:`read_counts`, or when a position is NaN or infinite.
    """
    counts, first, _, offsets = _mapped(path)
    some = slice(None, None, -(-counts.vertices // _POINTS))
    points = np.repeat(first[None, some].astype(np.float64), counts.frames, axis=0)
    points[1:] += offsets[:, some]
    finite = np.array([np.isfinite(first).all(), *(np.isfinite(frame).all() for frame in offsets)])
    if not finite.all():
        raise InputError(f"{path}: frame {int(np.argmin(finite))} has a NaN or infinite position")
    least = SAME * np.linalg.norm(np.ptp(points[rest], axis=0))
    chosen, nearest = [rest], np.full(counts.frames, np.inf)
    while len(chosen) <= count:
        nearest = np.minimum(nearest, [_apart(points[chosen[-1]], frame) for frame in points])
        if nearest.max() <= least:
            break
        chosen.append(int(nearest.argmax()))
    return sorted(chosen[1:])


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    R, t = rigid_motion(a, b)
    return float(np.sqrt(((a @ R.T + t - b) ** 2).sum(axis=1).mean()))


def _mapped(path: Path) -> tuple[Counts, np.ndarray, np.ndarray, np.ndarray]:
    """Counts, first frame, triangles and offsets, read as they are looked at."""
    counts = read_counts(path)
    try:
        content = np.memmap(path, dtype=np.uint8, mode="r", offset=_COUNTS)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not readable as {SUFFIX} ({_reason(error)})") from error
    ends = _TRIPLE * np.cumsum([counts.vertices, counts.triangles])
    first, F, offsets = np.split(content, ends)
    return (
        counts,
        first.view("<f4").reshape(-1, 3),
        F.view("<i4").reshape(-1, 3),
        offsets.view("<f4").reshape(counts.frames - 1, counts.vertices, 3),
    )


def _reason(error: Exception) -> str:
    return " ".join(str(error).split())

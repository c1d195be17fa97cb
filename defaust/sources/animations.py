"""Animation files ``.anime`` of DeformingThings4D: one list of triangles, and the vertices of every frame.

A file is little-endian, without padding. It begins with three int32, the counts of frames nf, vertices nv and
triangles nt. Three arrays follow: float32 (nv, 3), the vertices of the first frame; int32 (nt, 3), the
triangles; float32 (nf - 1, nv, 3), the displacements of each later frame from the first.

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
#: Size of the three counts, and of three numbers (a point, a displacement or a triangle), in bytes.
_COUNTS, _TRIPLE = 12, 12
#: Maximum distance of frames that count as the same pose, as a fraction of the rest frame's diagonal.
SAME = 1e-3
#: Maximum number of vertices that frames are compared by.
_POINTS = 2000


class Counts(NamedTuple):
    """Numbers of frames, vertices and triangles."""

    frames: int
    vertices: int
    triangles: int


def read_counts(path: Path) -> Counts:
    """Read the counts of a file, and check the size of the file against them.

    Raises
    ------
    InputError
        When a count is less than 1, or the file has another size.
    """
    try:
        size = path.stat().st_size
        counts = Counts(*np.fromfile(path, dtype="<i4", count=3).tolist())
    except (OSError, TypeError) as error:
        raise InputError(f"{path}: not readable as {SUFFIX} ({' '.join(str(error).split())})") from error
    if min(counts) < 1:
        found = f"{counts.frames} frames, {counts.vertices} vertices and {counts.triangles} triangles"
        raise InputError(f"{path}: not a {SUFFIX} file, it would have {found}")
    expected = _COUNTS + _TRIPLE * (counts.frames * counts.vertices + counts.triangles)
    if size != expected:
        raise InputError(
            f"{path}: has {size:,} bytes, but {counts.frames:,} frames of {counts.vertices:,} vertices with "
            f"{counts.triangles:,} triangles take {expected:,}; it is cut off, or not a {SUFFIX} file"
        )
    return counts


def read_frame(path: Path, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Read a frame; frames count from 0.

    Returns
    -------
    V : (n, 3) float64
    F : (m, 3) int64
        Not validated.

    Raises
    ------
    InputError
        As :func:`read_counts`, or when the frame does not exist.
    """
    counts, first, F, offsets = _mapped(path)
    if not 0 <= number < counts.frames:
        raise InputError(f"{path}: has no frame {number}; its frames are 0 to {counts.frames - 1}")
    V = first.astype(np.float64)
    return (V if number == 0 else V + offsets[number - 1]), F.astype(np.int64)


def far_frames(path: Path, *, rest: int, count: int) -> list[int]:
    """Choose frames that differ from one another, by farthest point sampling from the rest frame.

    The distance of two frames is the root mean square distance of their vertices after the best rigid
    motion, so a walk through the scene is not another pose. At most :data:`_POINTS` vertices are compared.

    Parameters
    ----------
    path : Path
    rest : int
        The rest frame; it is not part of the result.
    count : int
        Maximum number of frames. Sampling stops early when every remaining frame is within :data:`SAME` of
        a chosen frame.

    Returns
    -------
    list of int
        In order of time.

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
        nearest = np.minimum(nearest, [_distance(points[chosen[-1]], frame) for frame in points])
        if nearest.max() <= least:
            break
        chosen.append(int(nearest.argmax()))
    return sorted(chosen[1:])


def _distance(a: np.ndarray, b: np.ndarray) -> float:
    R, t = rigid_motion(a, b)
    return float(np.sqrt(((a @ R.T + t - b) ** 2).sum(axis=1).mean()))


def _mapped(path: Path) -> tuple[Counts, np.ndarray, np.ndarray, np.ndarray]:
    """Counts, first frame, triangles and displacements, mapped to memory."""
    counts = read_counts(path)
    content = np.memmap(path, dtype=np.uint8, mode="r", offset=_COUNTS)
    ends = _TRIPLE * np.cumsum([counts.vertices, counts.triangles])
    first, F, offsets = np.split(content, ends)
    return (
        counts,
        first.view("<f4").reshape(-1, 3),
        F.view("<i4").reshape(-1, 3),
        offsets.view("<f4").reshape(counts.frames - 1, counts.vertices, 3),
    )

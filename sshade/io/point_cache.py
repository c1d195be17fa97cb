"""Write the positions of a sequence as a point cache: PC2 or MDD.

Both formats hold the positions of all vertices for each pose, in single precision, without faces. Programs
apply them to the mesh of the rest shape, whose vertices must be in the same order. PC2 is little-endian: the
text ``POINTCACHE2`` and a zero byte, int32 version 1, int32 vertices, float32 first frame, float32 frames per
sample, int32 poses, and float32 positions. MDD is big-endian: int32 poses, int32 vertices, float32 times in
seconds, and float32 positions.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from sshade.io.document import as_floats
from sshade.io.files import replacing


def write_point_cache(path: Path, poses: Iterable[np.ndarray], *, vertices: int, times: np.ndarray) -> None:
    """Write poses as they come; the file appears whole or not at all.

    Parameters
    ----------
    path : path
        Ends with .pc2 or .mdd.
    poses : iterable of (n, 3) float64
        Positions of the vertices, one array for each time.
    vertices : int
        Their number n.
    times : (k,) float64
        In seconds, increasing. PC2 has no times, only poses at equal distances.

    Raises
    ------
    InputError
        When the file cannot be written, or positions are too large for single precision.
    """
    mdd = path.suffix.lower() == ".mdd"
    with replacing(path) as temporary, temporary.open("wb") as file:
        if mdd:
            file.write(struct.pack(">2i", len(times), vertices) + times.astype(">f4").tobytes())
        else:
            file.write(struct.pack("<12siiffi", b"POINTCACHE2\0", 1, vertices, 0.0, 1.0, len(times)))
        for V in poses:
            file.write(as_floats(V, path).astype(">f4" if mdd else "<f4").tobytes())

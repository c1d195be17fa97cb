"""Read STL files, text or binary, and write binary ones. Where positions change, all other bytes stay."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sshade.core.errors import counted
from sshade.files.mesh_file import MeshFile, as_floats, present, unchanged
from sshade.files.numbers_in_text import BOM, Numbers, Text, edited, key_of
from sshade.mesh.mesh import unit_rows
from sshade.mesh.normals import turned, turns
from sshade.mesh.surface import as_single, single_steps

#: A facet of a binary STL file.
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(path: Path) -> MeshFile:
    """Read an STL file. Each face has three vertices of its own.

    Raises
    ------
    ValueError
        When the file is no STL file, or ends early.
    """
    data, stored, rounding = path.read_bytes(), unchanged, None
    notes: tuple[str, ...] = ()
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    end = 84 + _FACET.itemsize * count
    if count >= 0 and len(data) >= end:
        facets = np.frombuffer(data, _FACET, count, 84)
        V = facets["corners"].reshape(-1, 3).astype(np.float64)

        def content(posed: np.ndarray, path: Path) -> bytes:
            changed = facets.copy()
            changed["normal"] = _turned(facets["normal"].astype(np.float64), V, posed)
            changed["corners"] = as_floats(posed, path).reshape(-1, 3, 3)
            return data[:84] + changed.tobytes() + data[end:]

        if further := len(data) - end:
            notes = (f"{counted(further, 'byte', 'bytes')} behind its last facet, which stay in the output",)
        stored, rounding = as_single, single_steps(V)
        holds = present(facet_attributes=facets["attribute"].any())
    elif data.removeprefix(BOM).lstrip()[:5].lower() == b"solid" and b"\0" not in data:
        normals, corners, solids, notes = _solids(Text(data))
        V, holds = corners.value, present(solids=solids > 1)

        def content(posed: np.ndarray, path: Path) -> bytes:
            return edited(data, [normals.edits(_turned(normals.value, V, posed)), corners.edits(posed)])

    else:
        raise ValueError(
            "it is neither a text that begins with solid, nor as long as the header of a binary file says"
        )
    F = np.arange(len(V)).reshape(-1, 3)
    return MeshFile(V, F, holds, (".stl",), content, notes, rounding, stored)


def write_stl(path: Path, V: np.ndarray, F: np.ndarray) -> None:
    """Write triangles as binary STL, with unit normals; faces without area have zeros.

    Parameters
    ----------
    path : path
    V : (n, 3) float64
        Written as float32.
    F : (m, 3) int
    """
    facets = np.zeros(len(F), _FACET)
    facets["corners"] = corners = V[F]
    facets["normal"] = unit_rows(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    path.write_bytes(bytes(80) + len(F).to_bytes(4, "little") + facets.tobytes())


def _solids(text: Text) -> tuple[Numbers, Numbers, int, tuple[str, ...]]:
    """Return the normals (m, 3), the corners (3m, 3), the number of solids, and notes for the user."""
    key = text.keys(fold=True)
    solid, end, facet, vertex = (key == key_of(word) for word in (b"solid", b"endsolid", b"facet", b"vertex"))
    facets, vertices = np.flatnonzero(facet), np.flatnonzero(vertex)
    corners, at = text.vectors(vertices, 1, "a vertex"), text.first[facets, None] + 2 + np.arange(3)
    at[text.size[facets] < 5] = text.first[facets[text.size[facets] < 5], None]  # a word that is no number
    normals = text.numbers(at, lenient=True)  # which programs write in many ways where a facet has no area
    count = np.diff(np.searchsorted(vertices, facets), append=len(vertices))
    if len(uneven := facets[count != 3]):
        raise ValueError(
            f"line {text.line_number(uneven[0])} begins a facet that does not have three vertices"
        )
    if len(vertices) != 3 * len(facets):
        raise ValueError("it has vertices before its first facet")
    unended = int(solid.sum() - end.sum())
    note = f"solids without a line endsolid: {unended} of {solid.sum()}; check that the file is complete"
    return normals, corners, int(solid.sum()), (note,) * (unended > 0)


def _turned(N: np.ndarray, rest: np.ndarray, V: np.ndarray) -> np.ndarray:
    """Turn facet normals (m, 3) with the surface; the zeros that many programs write stay zeros."""
    F = np.arange(len(rest)).reshape(-1, 3)
    return turned(turns(np.repeat(np.arange(len(N))[:, None], 3, axis=1), N, F, rest, V), N)

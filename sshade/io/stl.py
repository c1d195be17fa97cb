"""STL files, text or binary: positions and facet normals change, all else stays as it is."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from sshade.errors import InputError
from sshade.io.document import MeshFile, present, with_numbers
from sshade.io.normals import turns

#: A facet of a binary STL.
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
#: Keywords of a text STL that carry no numbers that are read here.
_WORDS = ("outer", "endloop", "endfacet")


def read_stl(path: Path) -> MeshFile:
    """Read an STL file: three vertices of its own for each face.

    Raises
    ------
    ValueError
        When it is no STL, or ends early.
    InputError
        When there are no triangles, or several solids.
    """
    data = path.read_bytes()
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    if len(data) == 84 + _FACET.itemsize * count:
        facets = np.frombuffer(data, _FACET, count, 84)
        V = facets["corners"].reshape(-1, 3).astype(np.float64)
        content = partial(_binary, data[:84], facets, V)
        holds = present(facet_attributes=facets["attribute"].any())
    elif data.lstrip()[:5].lower() == b"solid":
        lines = data.splitlines(keepends=True)
        V, corner_lines, N, normal_lines = _text_solid(lines, path)
        content, holds = partial(_text, lines, V, corner_lines, N, normal_lines), ()
    else:
        raise ValueError("it is neither a text that begins with solid, nor as long as its header says")
    if len(V) == 0:
        raise InputError(f"{path}: the file holds no triangles")
    return MeshFile(V, np.arange(len(V)).reshape(-1, 3), holds, (".stl",), content)


def _text_solid(lines: list[bytes], path: Path) -> tuple[np.ndarray, list[int], np.ndarray, list[int]]:
    """(3m, 3) corners of the facets of the one solid of a text, (m, 3) normals, and the lines of both."""
    corners: list[list[float]] = []
    normals: list[list[float]] = []
    corner_lines: list[int] = []
    normal_lines: list[int] = []
    solids, inside = 0, False
    for number, line in enumerate(lines, start=1):
        words = line.decode("latin-1").split()
        key = words[0].lower() if words else ""
        if key == "vertex" and inside:
            corners.append([float(word) for word in words[1:]])
            corner_lines.append(number - 1)
            if len(corners[-1]) != 3:
                raise ValueError(f"line {number}: a vertex needs three coordinates")
        elif key == "facet" and inside:
            normals.append([float(word) for word in words[2:5]])
            normal_lines.append(number - 1)
            if len(normals[-1]) != 3:
                raise ValueError(f"line {number}: a normal needs three coordinates")
        elif key in ("solid", "endsolid"):
            solids, inside = solids + (key == "solid"), key == "solid"
        elif key and not (key in _WORDS and inside):
            raise ValueError(f"line {number} is not understood: {' '.join(words)[:60]!r}")
        if key == "endloop" and len(corners) != 3 * len(normals):
            raise ValueError(f"line {number}: a facet has no three vertices")
    if inside or len(corners) != 3 * len(normals):
        raise ValueError("it ends within a solid")
    if solids > 1:
        raise InputError(f"{path}: the file holds {solids} meshes; give one mesh a file")
    return np.array(corners).reshape(-1, 3), corner_lines, np.array(normals).reshape(-1, 3), normal_lines


def _turned(N: np.ndarray, rest: np.ndarray, V: np.ndarray) -> np.ndarray:
    """Facet normals (m, 3) for positions V (3m, 3); one of zeros, which many programs write, stays that."""
    F = np.arange(len(rest)).reshape(-1, 3)
    return np.einsum("kij,kj->ki", turns(np.repeat(np.arange(len(N))[:, None], 3, axis=1), F, rest, V), N)


def _binary(head: bytes, facets: np.ndarray, rest: np.ndarray, V: np.ndarray, path: Path) -> bytes:
    facets = facets.copy()
    facets["normal"] = _turned(facets["normal"].astype(np.float64), rest, V)
    facets["corners"] = V.reshape(-1, 3, 3)
    return head + facets.tobytes()


def _text(
    lines: list[bytes],
    rest: np.ndarray,
    corner_lines: list[int],
    N: np.ndarray,
    normal_lines: list[int],
    V: np.ndarray,
    path: Path,
) -> bytes:
    lines = list(lines)
    for place, old, new in zip(corner_lines, rest.tolist(), V.tolist(), strict=True):
        lines[place] = with_numbers(lines[place], 1, old, new)
    for place, old, new in zip(normal_lines, N.tolist(), _turned(N, rest, V).tolist(), strict=True):
        lines[place] = with_numbers(lines[place], 2, old, new)
    return b"".join(lines)

"""Read marks: pairs of places on two meshes that correspond, such as two noses.

JSON::

    {"marks": [
        {"name": "nose", "source": 12, "target": 345},
        {"name": "left ear", "source": [x, y, z], "target": [x, y, z]}
    ]}

A place is the id of a vertex, or a position, which is snapped to the nearest vertex. Names are optional.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sshade.errors import InputError
from sshade.io.document import check_input
from sshade.io.files import naming
from sshade.io.keys import parsed_list, require_known
from sshade.io.points import as_array

if TYPE_CHECKING:
    from sshade.mesh.surface import Surface

#: The two meshes.
SIDES = ("source", "target")
KEYS = ("name", *SIDES)


class Marks(NamedTuple):
    """Marks of a file, before the meshes are known.

    Attributes
    ----------
    places : list of dict
        For each mark, the place on each side: an id, or a position (3,) float64.
    """

    places: list[dict[str, int | np.ndarray]]

    def on(self, source: Surface, target: Surface) -> np.ndarray:
        """Return the vertices (k, 2) int64 of the marks on two meshes that were read from files.

        Raises
        ------
        InputError
            When an id is out of range or belongs to no face, or a position is far from the mesh.
        """
        return np.stack(
            [self._on(side, surface) for side, surface in zip(SIDES, (source, target), strict=True)], axis=1
        )

    def _on(self, side: str, surface: Surface) -> np.ndarray:
        from sshade.snapping import snap_to_vertices  # imports large libraries

        found = np.empty(len(self.places), dtype=np.int64)
        positions = []
        for number, mark in enumerate(self.places):
            place = mark[side]
            if isinstance(place, np.ndarray):
                positions.append(number)
                continue
            if not 0 <= place < len(surface.vertex):
                last = len(surface.vertex) - 1
                raise InputError(
                    f'mark {number}: the "{side}" {place} is not in 0..{last}, the vertices there'
                )
            found[number] = surface.vertex[place]
            if found[number] < 0:
                raise InputError(f'mark {number}: the "{side}" vertex {place} belongs to no face')
        if positions:
            points = np.array([self.places[number][side] for number in positions])
            with naming(f'"{side}" of the marks'):
                found[positions] = snap_to_vertices(surface.mesh, points, np.array(positions), item="mark")[1]
        return found


def read_marks(path: Path) -> Marks:
    """Read a file of marks.

    Raises
    ------
    InputError
        When the file is missing, no JSON, or a mark is not a pair of places.
    """
    check_input(path, (".json",))
    with naming(path):
        data = parsed_list(path.read_bytes(), "marks")
        require_known(data, ("marks",))
        places = []
        for number, mark in enumerate(data["marks"]):
            with naming(f"mark {number}"):
                if not isinstance(mark, dict):
                    raise InputError("it is no JSON object")
                require_known(mark, KEYS)
                places.append({side: _place(mark.get(side), side) for side in SIDES})
    return Marks(places)


def _place(value: Any, side: str) -> int | np.ndarray:
    if isinstance(value, int) and not isinstance(value, bool):
        return value
    if isinstance(value, list):
        return as_array(value, f'"{side}"', (3,), "a position of three numbers")
    raise InputError(f'"{side}" must be the id of a vertex, or a position of three numbers')

"""Sentences of ``sshade deform`` on handles that miss their targets, and on positions that are rounded."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sshade.files.mesh_file import MeshFile
from sshade.files.meshes import SINGLE, read_file
from sshade.mesh.surface import Surface, as_single, is_single, single_steps
from sshade.problem.handles import Handles

#: Distance of a hard handle from its target that is a warning, as a fraction of the bounding-box diagonal.
MISSED = 1e-4
#: Rounding of positions that is worth a note, as a fraction of the bounding-box diagonal.
COARSE = 1e-6


def stored_positions(path: Path, file: MeshFile, V: np.ndarray) -> np.ndarray:
    """Return the positions that `path` holds after V (n, 3) were written to it: V itself, or rounded."""
    suffix = path.suffix.lower()
    if suffix not in file.suffixes:  # a file of the mesh alone
        return as_single(V) if suffix in SINGLE else V
    return read_file(path).V if file.stored is None else file.stored(V)


def reached(stored: np.ndarray, whole: Surface, handles: Handles) -> tuple[str, float]:
    """Return how near handles are to their targets, for the summary, and the error of the hard handles.

    Errors are fractions of the diagonal: the largest of the hard handles, and the mean of the soft handles.
    """
    at = whole.picked(stored)
    distance = np.linalg.norm(at[handles.index] - handles.target, axis=1)
    distance /= whole.mesh.diagonal
    hard = handles.hard
    error = float(distance[hard].max(initial=0.0))
    exact, soft = int(hard.sum()), int((~hard).sum())
    parts = []
    if exact:
        parts.append(f"{exact} handle{'s' * (exact > 1)} reached to {100 * error:.2g} %")
    if soft:
        mean = 100 * distance[~hard].mean()
        parts.append(f"{soft} soft handle{'s' * (soft > 1)} to {mean:.2g} % on average")
    return f"{' and '.join(parts)} of the diagonal", error


def warnings_of(error: float, *, rounding: float, exact: bool) -> list[str]:
    """Return a sentence if hard handles are far from their targets.

    Parameters
    ----------
    error, rounding : float
        Largest distance of a hard handle from its target, and of a stored position from the computed one, as
        fractions of the diagonal.
    exact : bool
        Whether the method places hard handles at their targets.
    """
    if error <= max(MISSED, 2 * rounding):
        return []
    advice = "" if exact else "; --method fast puts handles exactly at their targets"
    return [f"a handle is {100 * error:.2g} % of the diagonal away from its target{advice}"]


def rounding_notes(file: MeshFile, paths: tuple[Path, Path], *, moved: float, diagonal: float) -> list[str]:
    """Return a sentence for the input and the output, if its positions are coarsely rounded.

    Parameters
    ----------
    file : MeshFile
        The input.
    paths : (path, path)
        Of the input and of the output.
    moved : float
        Largest distance of a position in the output from the computed position.
    diagonal : float
    """
    steps = file.rounding
    if steps is None:
        steps = single_steps(file.V) if is_single(file.V) else np.zeros(3)
    source, output = paths
    found = []
    if (step := float(np.max(steps)) / diagonal) > COARSE:
        found.append(
            f"positions in {source} are rounded to steps of {100 * step:.2g} % of the diagonal, because the "
            "mesh is far from the origin; move it to the origin before it is stored in single precision"
        )
    if moved > COARSE * diagonal:
        found.append(
            f"{output} stores single precision, which moves positions by up to {100 * moved / diagonal:.2g} "
            "% of the diagonal; write .obj or .off in double precision, or move the mesh to the origin"
        )
    return found

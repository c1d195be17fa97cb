"""Registered meshes that cannot be right: copies, other bodies, other units, vertices out of place."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from defaust.folder.layout import sha256
from defaust.sources.source import Source
from sshade import InputError, Mesh

#: Largest relative change of the mean edge and of the volume from the rest pose. The poses of this project's
#: bodies change them by up to 4 and 7 %.
CHANGE = 0.2
#: Factor by which the edges of a pose may differ more from its rest pose than from that of another subject.
NEARER = 1.3
#: Largest length of an edge by its rest length, or by half the mean edge if that is longer. The poses of this
#: project's bodies have up to 6.4.
STRETCH = 10.0
#: Name of the rest pose in messages.
REST = "the rest pose"


def check_registrations(source: Source, subjects: list[int], *, strict: bool) -> None:
    """Read the registered meshes of some subjects.

    Raises
    ------
    InputError
        When two poses of a subject have equal vertices. With `strict` also on a mesh that cannot be used,
        equal files or meshes, a pose that differs from the rest pose by more than a pose can, and a pose that
        is another subject's.
    """
    seen: dict[bytes, tuple[int, str]] = {}
    rests: dict[int, Mesh] = {}
    lengths: dict[tuple[int, str], np.ndarray] = {}
    for subject in subjects:
        for name, mesh in _meshes(source, subject, strict=strict):
            content = hashlib.sha256(mesh.V.tobytes() + mesh.F.tobytes()).digest()
            of, other = seen.setdefault(content, (subject, name))
            if of == subject and other != name:
                raise InputError(
                    f"subject {subject}: {other} and {name} have equal vertices, so they are one pose; take "
                    "the files again, or leave one pose out"
                )
            if not strict:
                continue
            rest = rests.setdefault(subject, mesh)
            copied = "" if of == subject else f"it has the vertices of subject {of}, {other}"
            _refuse(subject, name, copied or difference(rest, mesh))
            if np.array_equal(mesh.F, rests[subjects[0]].F):
                lengths[subject, name] = _edge_lengths(mesh)
    for (subject, name), length in lengths.items():
        change = {
            of: float(np.abs(np.log(length / lengths[of, REST])).mean())
            for of, pose in lengths
            if pose == REST
        }
        of = min(change, key=change.__getitem__)
        if change[subject] > NEARER * change[of]:
            _refuse(subject, name, f"its edges are those of subject {of}")
    if strict:
        _require_no_copies(source.files)


def _refuse(subject: int, name: str, doubt: str) -> None:
    if doubt:
        raise InputError(
            f"subject {subject}, {name}: {doubt}; take the file again, or build with strict=false"
        )


def _require_no_copies(files: Iterable[Path]) -> None:
    """Raise InputError if two files are equal, also if the build does not read them."""
    seen: dict[str, str] = {}
    for path in files:
        if (other := seen.setdefault(sha256(path), path.name)) != path.name:
            raise InputError(
                f"{path.name} is a copy of {other}; take the files again, or build with strict=false"
            )


def _edge_lengths(mesh: Mesh) -> np.ndarray:
    """Return the lengths (e,) of the edges; none is zero."""
    i, j = mesh.edges.T
    return np.maximum(np.linalg.norm(mesh.V[i] - mesh.V[j], axis=1), np.finfo(float).tiny)


def _meshes(source: Source, subject: int, *, strict: bool) -> Iterator[tuple[str, Mesh]]:
    """Yield the poses that can be used with their names; with `strict`, the rest pose first."""
    for pose in (None, *source.poses(subject)) if strict else source.poses(subject):
        try:
            mesh = source.rest(subject) if pose is None else source.posed(subject, pose)
        except InputError as error:
            if strict:
                raise InputError(f"subject {subject}: {error}; strict=false leaves it out") from error
            continue
        if mesh is not None:
            yield REST if pose is None else pose.name, mesh


def difference(rest: Mesh, posed: Mesh) -> str:
    """Describe how a pose differs from the rest pose by more than a pose can; empty if it does not."""
    if not np.array_equal(rest.F, posed.F):
        return ""  # the build says so
    i, j = rest.edges.T
    before, after = (np.linalg.norm(mesh.V[i] - mesh.V[j], axis=1) for mesh in (rest, posed))
    edge = after.mean() / before.mean()
    if abs(edge - 1) > CHANGE:
        return f"its mean edge is {edge:.3g} times as long as at rest, as in other units or of another body"
    stretch = after / np.maximum(before, 0.5 * before.mean())
    worst = int(stretch.argmax())
    if stretch[worst] > STRETCH:
        edge = f"({i[worst]}, {j[worst]})"
        times = after[worst] / before[worst]
        return f"its edge {edge} is {times:.3g} times as long as at rest: a vertex is out of place"
    solid = rest.is_closed and rest.is_oriented and rest.volume != 0
    volume = posed.volume / rest.volume if solid else 1.0
    if abs(volume - 1) > CHANGE:
        return f"its volume is {volume:.3g} times that at rest, as of another body"
    return ""

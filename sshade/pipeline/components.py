"""Meshes of several components, or with edges and vertices that are not manifold: deformed piece by piece.

The method itself needs an oriented manifold of one component. Here a mesh is
cut into such pieces (:mod:`sshade.mesh.cutting`), which are deformed one after the
other, those with handles first, the larger first. Where a piece was cut from
one that is done, its vertices are held where those went, so that the pieces fit
together again. A component without handles is refused, or follows the nearest
one rigidly.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from sshade.errors import InputError
from sshade.mesh.cutting import Cut, cut_to_manifold
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.task import DeformationResult, DeformationTask, Handles, Progress, silent

#: Proxy vertices of a piece besides its handles, at least.
SPARE = 4
#: Vertices near each one of a loose component whose motion it follows.
NEAREST = 8


def deform_pieces(
    mesh: Mesh,
    handles: Handles,
    method: Callable[..., DeformationResult],
    *,
    vertices: int = 6000,
    carry_loose: bool = False,
    name: str = "mesh",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Deform a mesh that need not be manifold, oriented, or of one component.

    A mesh that is all of it gives what `method` gives, bit for bit.

    Parameters
    ----------
    mesh : Mesh
    handles : Handles
    method : callable
        Takes a task and ``vertices``, ``seed`` and ``progress``, such as
        :func:`sshade.deform` with its other parameters bound.
    vertices : int
        Proxy vertices of all pieces together, shared by area; a piece has at
        least its handles and a few more.
    carry_loose : bool
        Move components without handles rigidly with the nearest one, as the part
        of it does that is close to them.
    name : str
        Of the task.
    seed : int
    progress : Progress

    Returns
    -------
    DeformationResult
        `iterations` is the mean over pieces. ``extra`` has ``proxy_vertices`` in
        all, the largest ``residual``, the faces left ``tangled``, and the numbers of ``pieces`` deformed, of
        components ``carried``, of ``copies`` of vertices that cutting made and of
        faces ``turned`` to agree; ``gap`` is how far copies came apart before
        they were joined, over the diagonal.

    Raises
    ------
    InputError
        Those of the method; when a component has no handles and is not to be
        carried; when `vertices` exceeds the mesh's or is below the number of handles.
    """
    if handles.index.max() >= mesh.n:
        raise InputError(f"handle id {handles.index.max()} is out of range: the mesh has {mesh.n} vertices")
    loose = np.setdiff1d(mesh.component, mesh.component[handles.index])
    if len(loose) and not carry_loose:
        raise InputError(_complaint(mesh, loose))
    cut = cut_to_manifold(mesh)
    if cut.mesh.topology.components == 1 and cut.mesh is mesh:
        task = DeformationTask(name, mesh, handles)
        result = method(task, vertices=vertices, seed=seed, progress=progress)
        return _with(result, pieces=1, carried=0, copies=0, turned=0, gap=0.0)
    if not len(handles) <= vertices <= mesh.n:
        raise InputError(
            f"{vertices} proxy vertices were asked for: at least the {len(handles)} handle vertices "
            f"and at most the mesh's {mesh.n} are possible"
        )
    pieces = _Pieces(mesh, cut, handles)
    order = pieces.order()
    density = vertices / sum(pieces.area[p] for p in order)
    results = []
    for number, piece in enumerate(order, start=1):
        stage = f"piece {number} of {len(order)}"
        results.append(
            pieces.deform(
                piece,
                method,
                share=round(density * pieces.area[piece]),
                name=f"{name} {stage}",
                seed=seed,
                progress=lambda _, done, total, note="", stage=stage: progress(stage, done, total, note),
            )
        )
    if len(loose):
        _carry(mesh, pieces.placed, loose)
    facts = {"pieces": len(order), "carried": len(loose), "copies": len(cut.origin) - mesh.n}
    return _joined(pieces.placed, results, **facts, turned=cut.turned, gap=pieces.gap / mesh.diagonal)


class _Pieces:
    """The components of a cut mesh, and where vertices of the mesh have gone so far.

    Attributes
    ----------
    area : (p,) float64
        Of each piece.
    placed : (n, 3) float64
        Deformed positions; those at rest where no piece with the vertex is done.
    gap : float
        Largest distance of a copy to where its vertex was placed.
    """

    def __init__(self, mesh: Mesh, cut: Cut, handles: Handles) -> None:
        self._cut, self._handles = cut, handles
        self._piece = cut.mesh.component
        self._number = np.full(mesh.n, -1)
        self._number[handles.index] = np.arange(len(handles))
        self._members = _groups(self._piece)
        self._faces = _groups(self._piece[cut.mesh.F[:, 0]])
        self.area = np.bincount(self._piece[cut.mesh.F[:, 0]], cut.mesh.face_areas)
        self.placed, self._known, self.gap = np.array(mesh.V), np.zeros(mesh.n, dtype=bool), 0.0

    def order(self) -> list[int]:
        """Pieces with handles, then those that hang on one before them, the larger first."""
        beside = self._beside()
        held = np.unique(self._piece[self._number[self._cut.origin] >= 0])
        found: list[int] = []
        waiting, seen = sorted(held, key=lambda p: -self.area[p]), set(held)
        while waiting:
            found += waiting
            reached = set().union(*(beside.get(piece, ()) for piece in waiting))
            waiting = sorted(reached - seen, key=lambda p: (-self.area[p], p))
            seen |= reached
        return [int(piece) for piece in found]

    def _beside(self) -> dict[int, set[int]]:
        """For each piece those that have copies of its vertices."""
        copies = np.flatnonzero(np.bincount(self._cut.origin)[self._cut.origin] > 1)
        pairs = np.unique(np.stack([self._cut.origin[copies], self._piece[copies]], axis=1), axis=0)
        beside: dict[int, set[int]] = {}
        for pieces in np.split(pairs[:, 1], np.flatnonzero(np.diff(pairs[:, 0])) + 1):
            for piece in pieces.tolist():
                beside.setdefault(piece, set()).update(pieces.tolist())
        return beside

    def deform(
        self, piece: int, method: Callable[..., DeformationResult], *, share: int, name: str, **settings: Any
    ) -> DeformationResult:
        """Deform a piece and place its vertices."""
        own = self._members[piece]
        shape = Mesh(self._cut.mesh.V[own], np.searchsorted(own, self._cut.mesh.F[self._faces[piece]]))
        held = self._held(own)
        share = min(shape.n, max(share, len(held) + SPARE))
        try:
            result = method(DeformationTask(name, shape, held), vertices=share, **settings)
        except (InputError, FloatingPointError) as error:
            first = self._cut.origin[own[0]]
            raise type(error)(
                f"the piece of {shape.n} vertices around vertex {first} cannot be deformed: {error}"
            ) from error
        self._place(self._cut.origin[own], result.vertices)
        return result

    def _held(self, own: np.ndarray) -> Handles:
        """The handles of a piece, then the vertices that it shares with pieces that are done."""
        origin, given = self._cut.origin[own], self._handles
        number = self._number[origin]
        with_handle = np.flatnonzero(number >= 0)
        with_handle = with_handle[np.argsort(number[with_handle], kind="stable")]
        seam = np.flatnonzero((number < 0) & self._known[origin])
        number = number[with_handle]
        return Handles(
            np.concatenate([with_handle, seam]),
            np.concatenate([given.target[number], self.placed[origin[seam]]]),
            dynamic=np.concatenate([given.dynamic[number], np.ones(len(seam), dtype=bool)]),
            group=np.concatenate([given.group[number], np.full(len(seam), given.group.max() + 1)]),
        )

    def _place(self, origin: np.ndarray, V: np.ndarray) -> None:
        """The mean of the copies within a piece; a vertex that is placed stays."""
        new = ~self._known[origin]
        vertex, inverse, count = np.unique(origin[new], return_inverse=True, return_counts=True)
        mean = np.stack([np.bincount(inverse, x) for x in V[new].T], axis=1) / count[:, None]
        single = np.flatnonzero(count[inverse] == 1)
        mean[inverse[single]] = V[new][single]  # to the last bit
        self.placed[vertex] = mean
        self._known[vertex] = True
        self.gap = max(self.gap, float(np.linalg.norm(V - self.placed[origin], axis=1).max()))


def _groups(labels: np.ndarray) -> list[np.ndarray]:
    """For each label from 0 the places that have it, in ascending order."""
    order = np.argsort(labels, kind="stable")
    return np.split(order, np.cumsum(np.bincount(labels))[:-1])


def _carry(mesh: Mesh, placed: np.ndarray, loose: np.ndarray) -> None:
    """Move each loose component as the vertices close to it of the nearest other one."""
    from scipy.spatial import cKDTree

    members = _groups(mesh.component)
    others = np.flatnonzero(np.isin(mesh.component, loose, invert=True))
    tree, trees = cKDTree(mesh.V[others]), {}
    for own in (members[component] for component in loose):
        distance, nearest = tree.query(mesh.V[own])
        leader = mesh.component[others[nearest[np.argmin(distance)]]]
        if leader not in trees:
            trees[leader] = cKDTree(mesh.V[members[leader]])
        _, near = trees[leader].query(mesh.V[own], k=min(NEAREST, len(members[leader])))
        near = members[leader][np.unique(near)]
        R, t = rigid_motion(mesh.V[near], placed[near])
        placed[own] = mesh.V[own] @ R.T + t


def _complaint(mesh: Mesh, loose: np.ndarray) -> str:
    sizes = np.bincount(mesh.component)
    first = int(np.argmax(mesh.component == loose[0]))
    return (
        f"{len(loose)} of the mesh's {len(sizes)} components have no handle (the first has {sizes[loose[0]]} "
        f"vertices, one of them {first}); give each one, weld coincident vertices with --repair, or move "
        "them with the nearest component with --carry-loose"
    )


def _joined(V: np.ndarray, results: list[DeformationResult], **facts: Any) -> DeformationResult:
    stages = {stage for result in results for stage in result.seconds}
    converged = [result.converged for result in results]
    return DeformationResult(
        vertices=V,
        iterations=float(np.mean([result.iterations for result in results])),
        converged=None if None in converged else all(converged),
        seconds={stage: sum(r.seconds.get(stage, 0.0) for r in results) for stage in sorted(stages)},
        extra={
            "proxy_vertices": sum(r.extra.get("proxy_vertices", 0) for r in results),
            "residual": max(r.extra.get("residual", 0.0) for r in results),
            "tangled": sum(r.extra.get("tangled", 0) for r in results),
            **facts,
        },
    )


def _with(result: DeformationResult, **facts: Any) -> DeformationResult:
    return DeformationResult(
        result.vertices, result.iterations, result.converged, result.seconds, {**result.extra, **facts}
    )

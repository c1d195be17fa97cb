"""The components of a cut mesh: their handles, their proxy vertices, and the positions found so far."""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from sshade.core.errors import InputError
from sshade.core.progress import Progress
from sshade.mesh.cutting import Cut
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import common_motion
from sshade.mesh.sides import flagged, members, numbered
from sshade.method.junctions import deform_joined
from sshade.method.regions import EDGE_SAMPLES
from sshade.problem.options import Options
from sshade.problem.task import DeformationTask, Handles
from sshade.proxy.sample import least_vertices, proxy_vertices, shared_vertices


class ComponentSet:
    """The components of a cut mesh, and the positions found so far.

    Attributes
    ----------
    area : (c,) float64
        Of each component.
    positions : (n, 3) float64
        Deformed positions; rest positions where no component with the vertex is done.
    one_sided : (n,) bool
        Vertices of one-sided surfaces that were deformed.
    seconds : dict of float
        Time of the solve that placed the junctions.
    gaps : dict of float
        "gap": largest distance of a copy from the position of its vertex. "side_gap": the same where the
        copies are the sides of a one-sided surface.
    """

    def __init__(self, mesh: Mesh, cut: Cut, task: DeformationTask, options: Options) -> None:
        handles = task.handles
        self._cut, self._handles, self._task, self._options = cut, handles, task, options
        self._component, count = cut.mesh.component, cut.mesh.topology.components
        self._number = numbered(handles.index, mesh.n)
        self._members = members(self._component, count)
        of_face = self._component[cut.mesh.F[:, 0]]
        self._faces = members(of_face, count)
        self.area = np.bincount(of_face, cut.mesh.face_areas)
        # Number of sides of the surface in each component: 2 where it covers a one-sided surface.
        self._sides = np.where(flagged(of_face[mesh.m :], count), 2, 1)
        self._hard = handles.hard & ~handles.has_rotation
        self._guess = [task.guess] * count
        self.seconds: dict[str, float] = {}
        self.positions, self._done = np.array(mesh.V), np.zeros(mesh.n, dtype=bool)
        self.gaps, self.one_sided = {"gap": 0.0, "side_gap": 0.0}, np.zeros(mesh.n, dtype=bool)
        # Number of copies of each vertex in each component.
        entries = np.ones(len(cut.origin)), (cut.origin, self._component)
        self._copies = csr_array(entries, shape=(mesh.n, count))

    def order(self) -> list[int]:
        """Return components with handles, then components joined to earlier components; larger first."""
        copies = self._copies
        beside, waiting = copies.T @ copies, copies.T @ (self._number >= 0) > 0
        found: list[int] = []
        seen = waiting
        while waiting.any():
            ids = np.flatnonzero(waiting)
            found += ids[np.argsort(-self.area[ids], kind="stable")].tolist()
            waiting = (beside @ waiting > 0) & ~seen
            seen = seen | waiting
        return found

    def place_junctions(self, order: list[int], progress: Progress) -> None:
        """Fix the junctions of components that will be deformed, and let each of them begin where they fit.

        A junction has copies in several components, or more copies than sides in one component.
        """
        chosen = flagged(np.array(order, dtype=np.int64), len(self.area))
        junction = self._copies @ (chosen / self._sides) > 1
        chosen &= self._copies.T @ junction > 0
        number = self._number[junction]
        if (self._handles.hard[number] & (number >= 0)).all():
            return
        begin = perf_counter()
        vertex = np.flatnonzero(chosen[self._component])
        cut, origin, guess = self._cut.mesh, self._cut.origin[vertex], self._task.guess
        V = deform_joined(
            cut.part(vertex, chosen[self._component[cut.F[:, 0]]]),
            origin,
            junction[origin],
            self._handles_of(origin),
            self._options,
            guess=None if guess is None else guess[origin],
            progress=progress,
        )
        placed = np.array(self._task.mesh.V)
        placed[origin] = at_means(origin, V)
        junction[self._handles.index[self._handles.hard]] = False
        self.positions[junction], self._done[junction] = placed[junction], True
        for component in np.flatnonzero(chosen):
            self._guess[component] = placed
        self.seconds["junctions"] = perf_counter() - begin

    def proxy_vertices(self, order: list[int]) -> np.ndarray:
        """Return (c,) int64: the numbers of proxy vertices of components that are deformed in this order.

        Raise InputError if the handles of the components find no room on the proxy.
        """
        asked, handles = self._options.vertices, int((~self._done[self._handles.index]).sum())
        if asked < (needed := min(handles, EDGE_SAMPLES)):
            raise InputError(
                f"{asked} proxy vertices were asked for: at least {needed} are needed, to hold the {handles} "
                "handle vertices; raise the option vertices"
            )
        fixed = self._done | (self._number >= 0)
        least, most = np.zeros((2, len(order)), dtype=np.int64)
        for number, component in enumerate(order):
            origin = self._cut.origin[self._members[component]]
            n, handles = len(origin), int(fixed[origin].sum())
            least[number] = min(n, least_vertices(handles))
            most[number] = proxy_vertices(n, n, handles, coarser=self._options.coarser)
            fixed[origin] = True
        return shared_vertices(asked, self.area[order], least, most)

    def move_with_handles(self, component: int) -> bool:
        """Move a component by the rigid motion that its hard handles share; return whether there is one.

        Components that are joined to others stay, because a joint may belong to a shape that bends.
        """
        origin, handles = self._cut.origin[self._members[component]], self._handles
        number = np.unique(self._number[origin])
        number = number[number >= 0]
        if len(number) == 0 or not self._hard[number].all():
            return False
        if (np.diff(self._copies.indptr)[origin] > 1).any() or self._options.volume_goal is not None:
            return False
        motion = common_motion(self._task.mesh.V[handles.index[number]], handles.target[number])
        if motion is None:
            return False
        R, t = motion
        self.positions[origin] = self._task.mesh.V[origin] @ R.T + t
        self.positions[handles.index[number]] = handles.target[number]
        self._done[origin] = True
        return True

    def sides(self, component: int) -> int:
        """Return the number of sides of the surface that a component covers."""
        return int(self._sides[component])

    def origin(self, component: int) -> np.ndarray:
        """Return the vertices (k,) of the uncut mesh of a component's vertices."""
        return self._cut.origin[self._members[component]]

    def part(self, component: int, vertices: int) -> tuple[DeformationTask, dict[str, Any]]:
        """Return the task of a component, and options that differ from the options of the whole.

        Parameters
        ----------
        component : int
        vertices : int
            Its share of the proxy vertices.
        """
        vertex, origin, guess = self._members[component], self.origin(component), self._guess[component]
        shape, handles = self._cut.mesh.part(vertex, self._faces[component]), self._handles_of(origin)
        two_sided = self._sides[component] == 1
        if not two_sided and self._options.volume_goal is not None:
            raise InputError(
                f"the surface around vertex {origin[0]} has one side and no volume; give it no volume goal"
            )
        vertices, coarser = max(vertices, least_vertices(len(handles))), self._options.coarser
        changes: dict[str, Any] = {
            "vertices": proxy_vertices(vertices, shape.n, len(handles), coarser=coarser)
        }
        if not two_sided:  # the sides enclose nothing
            changes["volume"] = 0.0
            if self._options.thickness:
                changes["thickness"] = 0.0
        guess = None if guess is None else guess[origin]
        return DeformationTask("component", shape, handles, guess=guess), changes

    def put(self, component: int, V: np.ndarray) -> None:
        """Store the deformed positions (k, 3) of a component's vertices."""
        origin, sides = self.origin(component), self._sides[component]
        self._take_over(origin, V, "gap" if sides == 1 else "side_gap")
        self.one_sided[origin] |= sides == 2

    def _handles_of(self, origin: np.ndarray) -> Handles:
        """Handles of a component, then copies of finished vertices, fixed at their positions."""
        handles, number = self._handles, self._number[origin]
        fixed = self._done[origin] & ~((number >= 0) & handles.hard[number])  # also where a handle is soft
        with_handle, seam = np.flatnonzero((number >= 0) & ~fixed), np.flatnonzero(fixed)
        with_handle = with_handle[np.argsort(number[with_handle], kind="stable")]
        number = number[with_handle]
        of_seam = {"dynamic": True, "group": handles.group.max() + 1, "weight": np.inf}
        fields: dict[str, Any] = {"index": np.concatenate([with_handle, seam])}
        fields["target"] = np.concatenate([handles.target[number], self.positions[origin[seam]]])
        for name, value in {**of_seam, "portion": 1.0, "rotation": np.nan}.items():
            if (values := getattr(handles, name)) is not None:
                further = np.full((len(seam), *values.shape[1:]), value)
                fields[name] = np.concatenate([values[number], further])
        return Handles(**fields).following(handles.majority)

    def _take_over(self, origin: np.ndarray, V: np.ndarray, name: str) -> None:
        """Store the mean of the copies within a component; finished vertices stay."""
        new = ~self._done[origin]
        self.positions[origin[new]] = at_means(origin[new], V[new])
        self._done[origin] = True
        gap = np.linalg.norm(V - self.positions[origin], axis=1).max()
        self.gaps[name] = max(self.gaps[name], float(gap))


def at_means(vertex: np.ndarray, V: np.ndarray) -> np.ndarray:
    """Replace each of the positions V (k, 3) by the mean of all positions of its vertex (k,)."""
    _, inverse, count = np.unique(vertex, return_inverse=True, return_counts=True)
    return np.stack([(np.bincount(inverse, x) / count)[inverse] for x in V.T], axis=1)

"""The majority motion: the rigid motion on which most handle groups of a mesh agree.

It has the least sum of distances between the moved centres of the groups at rest and their centres at the
targets (:func:`sshade.mesh.rotations.fit_median`). Groups that agree hold the motion against fewer others,
however far those move. A rotation has levers: two hands turn it in spite of the head and both feet. The best
translation is therefore found as well, and takes the place of the rotation where more groups agree on it.
Half of a move gives half of the motion.

The term fades before the groups cease to agree. A majority may still go over from one motion to another at
once. While handles are dragged, the motion therefore follows with a bounded speed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import SPREAD, rigid_motion
from sshade.mesh.rotations import fit_median

#: Distance within which groups agree with the motion, and vertices are pulled towards it, as a fraction of
#: the diagonal. Handles of one group with a chain of gaps below it, or below `EDGES` mean edges, count once.
REACH, EDGES = 0.05, 2.0
#: Least number of groups that agree.
LEAST = 3
#: Number of nearest handles to which a handle is linked.
LINKS = 8
#: Largest change of the motion in a drag, as a multiple of the change of the targets. A change of the
#: certainty by 1 counts as the reach.
FOLLOW = 4.0
#: Number of fits, and least distance in a weight, as a fraction of the diagonal.
FITS, NEAREST = 20, 1e-6


@dataclass(frozen=True, eq=False)
class MajorityMotion:
    """A rigid motion, p -> R (p - source) + target, and where it applies.

    Attributes
    ----------
    rotation : (3, 3) float64
    source, target : (3,) float64
    reach : float
        Distance from the motion at which a vertex is let go, in the unit of length.
    area : float
        Of the whole mesh.
    certainty : float
        Falls from 1 to 0 as the groups cease to agree.
    state : str
        "on", "fades", or "off: " and the reason.
    """

    rotation: np.ndarray
    source: np.ndarray
    target: np.ndarray
    reach: float
    area: float
    certainty: float
    state: str

    def moved(self, V: np.ndarray) -> np.ndarray:
        """Move points (k, 3)."""
        return (V - self.source) @ self.rotation.T + self.target


class HandleGroups:
    """The handle groups of a whole mesh, each in pieces that lie near each other, for any targets.

    Parameters
    ----------
    mesh : Mesh
        Rest shape.
    index, group : (k,) int
        Handle vertices and their groups, as of :class:`sshade.Handles`.
    """

    def __init__(self, mesh: Mesh, index: np.ndarray, group: np.ndarray) -> None:
        P = mesh.V[index]
        self._reach, self._area, self._diagonal = REACH * mesh.diagonal, mesh.area, mesh.diagonal
        self._number = _linked(P, group, max(self._reach, EDGES * mesh.mean_edge))
        self._size = np.bincount(self._number)
        self._rest = self._centres(P)

    def _centres(self, P: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(self._number, x) for x in P.T], axis=1) / self._size[:, None]

    def motion(self, target: np.ndarray) -> MajorityMotion:
        """Return the majority motion for targets (k, 3) of the handles."""
        rest, moved = self._rest, self._centres(target)
        R, source, goal = np.eye(3), rest.mean(axis=0), moved.mean(axis=0)
        certainty, state = 0.0, f"off: fewer than {LEAST} handle groups"
        if len(rest) >= LEAST:
            R, source, goal = self._fit(moved)
            distance = np.linalg.norm((rest - source) @ R.T + goal - moved, axis=1)
            firm = np.clip(2.0 - 2.0 * distance / self._reach, 0.0, 1.0)
            agreement, spread = np.sort(firm)[-self._needed], self._spread(firm)
            certainty = float(agreement * spread)
            state = "on" if certainty == 1.0 else "fades"
            if agreement == 0.0:
                state = "off: too few handle groups move together"
            elif spread == 0.0:
                state = "off: the handle groups that move together lie in a line"
        return MajorityMotion(R, source, goal, self._reach, self._area, certainty, state)

    def following(self, last: tuple[MajorityMotion, np.ndarray] | None, target: np.ndarray) -> MajorityMotion:
        """Return the motion for the targets of a drag, near the `last` motion and its targets."""
        found = self.motion(target)
        if last is None:
            return found
        before, rest = last[0], self._rest
        most = FOLLOW * float(np.linalg.norm(target - last[1], axis=1).max(initial=0.0))
        change, old = most / self._reach, before.moved(rest)
        certainty = float(np.clip(found.certainty, before.certainty - change, before.certainty + change))
        state = found.state if certainty == found.certainty else "fades"
        found = replace(found, certainty=certainty, state=state)
        move = found.moved(rest) - old
        far = float(np.linalg.norm(move, axis=1).max())
        if before.certainty == 0.0 or far <= most:
            return found
        at = old + most / far * move
        R, _ = rigid_motion(rest, at)
        return replace(found, rotation=R, source=rest.mean(axis=0), target=at.mean(axis=0))

    @property
    def _needed(self) -> int:
        """Number of groups that must agree."""
        return max(LEAST, (len(self._rest) + 1) // 2)

    def _fit(self, moved: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return R, source and target of the motion for moved centres (g, 3)."""
        rest, nearest = self._rest, NEAREST * self._diagonal
        found, misfit = [], []
        for turns in (False, True):
            at, distance = fit_median(rest, moved, turns, FITS, nearest)
            found.append(at)
            misfit.append(max(np.sort(distance)[self._needed - 1], nearest))
        # Up to half of the misfit of the other motion the translation counts alone, from twice not at all.
        part = float(np.clip(2.0 - 3.0 * misfit[0] / sum(misfit), 0.0, 1.0))
        between = part * found[0] + (1.0 - part) * found[1]
        R, _ = rigid_motion(rest, between)
        return R, rest.mean(axis=0), between.mean(axis=0)

    def _spread(self, firm: np.ndarray) -> float:
        """Return how well the groups that agree determine a rotation, from 0 for a line to 1."""
        if not firm.any():
            return 0.0
        arm = self._rest - firm @ self._rest / firm.sum()
        size = np.linalg.svd(np.sqrt(firm)[:, None] * arm, compute_uv=False)
        return float(np.clip(2.0 * size[1] / (SPREAD * size[0]) - 1.0, 0.0, 1.0)) if size[0] > 0 else 0.0


def _linked(P: np.ndarray, group: np.ndarray, link: float) -> np.ndarray:
    """(k,) int32: number the sets of handles of one group that are joined by gaps shorter than `link`."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    k = len(P)
    near = cKDTree(P).query(P, k=min(LINKS, k), distance_upper_bound=link)[1].reshape(k, -1)
    first, second = np.repeat(np.arange(k), near.shape[1]), near.ravel()
    there = second < k
    first, second = first[there], second[there]
    same = group[first] == group[second]
    first, second = first[same], second[same]
    return connected_components(coo_array((np.ones(len(first)), (first, second)), shape=(k, k)))[1]

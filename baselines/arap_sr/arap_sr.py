"""ARAP with smooth rotations (ARAP-SR, also SR-ARAP) at full resolution.

    E = sum_i sum_j w_ij |e'_ij - R_i e_ij|^2 + alpha A sum_i sum_j v_ij |R_i - R_j|_F^2

with e_ij = p_i - p_j at rest and e'_ij deformed, w_ij the cotangent weights, A
the rest area (which frees alpha of the model's scale) and v_ij = 1 / deg(i). Its
global step is that of spokes ARAP; the local step of vertex i maximises
``tr(R_i S~_i)``, ``S~_i = sum_j w_ij e_ij e'_ij^T + (alpha A / deg(i)) sum_j R_j^T``.

The second term outweighs the first by about alpha n : 1, so that rotations
spread by diffusion and the iterations needed grow like n: on dense meshes the
method stops at the cutoff, far from its minimum although vertices hardly move
any more. Anderson acceleration of the positions and rotations together, not
part of the paper, comes near it in about a hundred iterations.

Z. Levi, C. Gotsman, "Smooth rotation enhanced as-rigid-as-possible mesh
animation", IEEE TVCG 21(2), 2015.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from baselines.arap_sr.anderson import Anderson
from baselines.arap_sr.smooth_rotations import Cells, band_position, largest_turn, matrices, vertex_colours
from baselines.iteration import Plain, iterated
from baselines.stopwatch import Stopwatch
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.options import Start
from sshade.progress import Progress, silent
from sshade.solver.linear import Factorised
from sshade.solver.run import Stop, run
from sshade.solver.start import initial_guess
from sshade.solver.terms.arap import forces
from sshade.task import DeformationResult, DeformationTask

#: Differences that the acceleration keeps.
WINDOW = 5
#: A step this much longer than the one before it ends an acceleration; it begins anew.
LONGER = 2.0


def arap_sr(
    task: DeformationTask,
    *,
    alpha: float = 0.02,
    clamp: bool = True,
    accelerate: bool = False,
    tolerance: float = 1e-5,
    max_iterations: int = 1000,
    start: Start = "rest",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Deform with ARAP-SR; one iteration is a sweep over the rotations, then a global step.

    The sweep is Gauss-Seidel, each rotation from the newest ones of its
    neighbours, in the order of a greedy colouring (see :mod:`baselines.arap_sr.smooth_rotations`).
    Compared with Jacobi's two buffers the rotations spread about twice as far in
    a sweep; and unlike CGAL's sweep in the order of the vertices, which gives
    much the same, one by colours fits the rotations of a colour in one call.

    Differences from CGAL's SRE_ARAP: the local step comes first, as everywhere in
    this project; a boundary edge has one weight, where
    CGAL's counts from one of its ends only; a residual of positions stops it,
    not the energy without its rotation term, nor after 5 iterations. From
    Open3D's "Smoothed": Gauss-Seidel for Jacobi, half its weight on boundary
    edges, each cotangent clamped and not their mean, smoothing from the first
    iteration; its default alpha of 0.01 with a factor of 2 is the same term.

    Parameters
    ----------
    task : DeformationTask
        Its mesh may have a boundary and several components.
    alpha : float
        Weight of the rotations' smoothness. 0 is ARAP, infinity one rotation for all.
    clamp : bool
        Raise negative cotangents to zero, as CGAL does; without, the energy has no lower
        bound of zero where angles are obtuse.
    accelerate : bool
        Anderson acceleration, off in the paper.
    tolerance : float
        Residual under which iteration stops: the largest move of a vertex over the diagonal, or
        of a rotation as a unit quaternion, whichever is larger. Rotations are unknowns here,
        and spread so slowly over a fine mesh that positions alone can stand still long before.
        0 never stops early.
    max_iterations : int
        Cutoff; the paper's is 1000.
    start : {"rest", "rigid"}
        See :func:`sshade.solver.start.initial_guess`.
    seed : int
        Unused: the method is deterministic.
    progress : Progress

    Returns
    -------
    DeformationResult
        ``extra`` holds ``rotations`` (n, 3, 3) of the last sweep, ``residual``,
        ``restarts`` of the acceleration, and ``colours``.

    Raises
    ------
    InputError
        On an unknown start, or an alpha that is negative or infinite.
    """
    if not 0 <= alpha < np.inf:
        raise InputError(f"alpha={alpha!r} is no weight; it takes a number from 0")
    watch = Stopwatch()
    mesh, handles = task.mesh, task.handles
    handles.require_hard("ARAP-SR")
    U = initial_guess(task, start)
    R0 = rigid_motion(mesh.V[handles.index], handles.target)[0] if start == "rigid" else np.eye(3)
    colour = vertex_colours(mesh)
    # Kernels meet the vertices colour by colour, and neighbours close together within a colour.
    order = np.lexsort((band_position(mesh), colour))
    position = np.empty_like(order)
    position[order] = np.arange(mesh.n)
    cells = Cells(Mesh(mesh.V[order], position[mesh.F]), alpha=alpha, clamp=clamp, colour=colour[order])
    linear = Factorised(cells.laplacian, position[handles.index])
    watch.end("precompute")

    state = _State(cells, linear, R0, U[order], accelerate=accelerate, diagonal=mesh.diagonal)
    if task.guess is not None:
        cells.fit(state.u, state.Q, state.R, smooth=False)
    done = run(state, Stop(tolerance, max_iterations), progress=progress)
    watch.end("solve")
    facts = {"restarts": state.restarts, "colours": int(colour.max()) + 1}
    rotations = state.R.reshape(-1, 3, 3)[position]
    return iterated(state.u[position], done, watch.seconds, rotations=rotations, **facts)


class _State(Plain):
    """Positions and rotations, under a local and a global step.

    Attributes
    ----------
    Q : (n, 4) float64
    R : (n, 9) float64
        The rotations as unit quaternions and as matrices.
    restarts : int
    """

    def __init__(
        self,
        cells: Cells,
        linear: Factorised,
        R0: np.ndarray,
        u: np.ndarray,
        *,
        accelerate: bool,
        diagonal: float,
    ) -> None:
        super().__init__(self._iterate, u, diagonal=diagonal)
        x, y, z, w = Rotation.from_matrix(R0).as_quat()
        self.Q, self.R = np.tile([w, x, y, z], (len(u), 1)), np.tile(R0.ravel(), (len(u), 1))
        self._cells, self._linear = cells, linear
        self._before, self._B = self.Q.copy(), np.empty_like(u)
        self._acceleration = _Acceleration(len(u), scale=diagonal) if accelerate else None

    @property
    def restarts(self) -> int:
        return self._acceleration.restarts if self._acceleration else 0

    def _iterate(self, u: np.ndarray, out: np.ndarray) -> None:
        self._before[:] = self.Q
        self._cells.fit(u, self.Q, self.R)
        forces(self._cells.elements, u, self.R, self._B, 0, len(u))
        self._linear.solve(self._B, out)
        out += u

    def step(self) -> float:
        """Return the residual: the largest move of a vertex, or of a rotation as a unit quaternion."""
        return max(super().step(), float(largest_turn(self.Q, self._before)))

    def move(self, *, last: bool) -> None:
        """Go on to the plain iterate, or to an accelerated one, rotations included."""
        if last or self._acceleration is None:
            super().move(last=last)
        else:
            self._acceleration.mix(self.u, self.g, before=self._before, Q=self.Q)
            matrices(self.Q, self.R)


class _Acceleration:
    """Anderson acceleration of positions and quaternions as one vector.

    The rotations are part of what is iterated: a sweep does not fit them to the
    positions alone. The sweep decreases no energy that could tell a bad iterate
    from a good one, so the length of the step does: where it grows by more than
    :data:`LONGER`, the plain iterate is taken and the history dropped.
    """

    def __init__(self, n: int, *, scale: float) -> None:
        self.restarts = 0
        self._scale, self._last = scale, np.inf
        self._x, self._g = np.empty(7 * n), np.empty(7 * n)
        self._mixer = Anderson(7 * n, WINDOW)

    def mix(self, u: np.ndarray, g: np.ndarray, *, before: np.ndarray, Q: np.ndarray) -> None:
        """Replace u and Q, which led from `u` and `before` to `g` and `Q`, by the next iterate."""
        n, x, out = len(u), self._x, self._g
        for vector, positions, quaternions in ((x, u, before), (out, g, Q)):
            np.divide(positions.ravel(), self._scale, out=vector[: 3 * n])
            vector[3 * n :] = quaternions.ravel()
        step = float(np.linalg.norm(out - x))
        if step > LONGER * self._last:
            self.restarts += 1
            self._mixer = Anderson(len(x), WINDOW)
            u[:] = g
        else:
            self._mixer.advance(x, out)
            u[:] = self._scale * x[: 3 * n].reshape(n, 3)
            Q[:] = x[3 * n :].reshape(n, 4)
        self._last = step

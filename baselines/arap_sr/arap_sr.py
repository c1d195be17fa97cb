"""ARAP with smooth rotations (ARAP-SR, also SR-ARAP) at full resolution, by the iteration of CGAL.

An iteration has two steps. The local step sweeps over the vertices; the new rotation of vertex i maximises
``tr(R_i S~_i)`` with ``S~_i = sum_j w_ij e_ij e'_ij^T + (alpha A / deg(i)) sum_j R_j^T``. e_ij = p_i - p_j is
an edge at rest and e'_ij the deformed edge, w_ij are the cotangent weights, and the rest area A makes alpha
independent of the model's scale. The global step is the global step of spokes ARAP.

The result is the fixed point of this iteration, as in CGAL, where its author co-wrote the manual. It is near
the minimum of

    E = sum_i sum_j w_ij |e'_ij - R_i e_ij|^2 + alpha A sum_i 1 / (2 deg(i)) sum_j |R_i - R_j|_F^2,

but not at it: an exact local step for E has ``alpha A (1 / deg(i) + 1 / deg(j)) / 2`` as the factor of R_j.
Where all vertices have the same degree, the two agree.

The second term outweighs the first by a factor of about alpha n. Rotations therefore spread by diffusion, and
the number of iterations grows like n. On dense meshes the method stops at the maximum number of iterations,
far from its fixed point, although vertices hardly move. Anderson acceleration of positions and rotations,
which is not part of the paper, approaches the fixed point in about a hundred iterations.

Proof: the formulas above in a dense implementation with loops (tests/baselines/test_arap_sr.py). Outside the
tests, positions were compared with CGAL 5.5's SRE_ARAP. In its order of the sweep they agree to 1.1e-14 of
the diagonal over 21 iterations, in the order of colours to 4e-6 after 1,000 iterations on 170,000 vertices.

Z. Levi, C. Gotsman, "Smooth rotation enhanced as-rigid-as-possible mesh
animation", IEEE TVCG 21(2), 2015.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from baselines.arap_sr.anderson import Anderson
from baselines.arap_sr.smooth_rotations import Cells, band_position, largest_turn, matrices, vertex_colours
from baselines.hard_handles import require_hard
from baselines.iteration import Plain, iterated
from baselines.stopwatch import Stopwatch
from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.mesh.mesh import Mesh
from sshade.mesh.rigid import rigid_motion
from sshade.problem.options import Start, Stop
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.solver.aim import initial_guess
from sshade.solver.factorisation import Factorised
from sshade.solver.run import run

#: Number of differences that the acceleration keeps.
WINDOW = 5
#: Growth of the energy, as a ratio, beyond which an accelerated iterate is dropped. Near the fixed point,
#: which is not exactly at the minimum, the energy grows by up to 1e-5 in an iteration.
RISE = 1.0001


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
    """Deform with ARAP-SR. An iteration is a sweep over the rotations and a global step.

    The sweep is a Gauss-Seidel sweep in the order of a greedy colouring (see
    :mod:`baselines.arap_sr.smooth_rotations`). In a Gauss-Seidel sweep, rotations spread about twice as far
    as in a Jacobi sweep. CGAL sweeps in the order of the vertices with nearly the same result; a sweep by
    colours fits all rotations of a colour in one call.

    Differences from CGAL's SRE_ARAP: the local step comes first, as everywhere in this project. A boundary
    edge has the same weight at both ends, as in CGAL 5.5.1; newer sources of CGAL count it at one end only. A
    residual stops the iteration; CGAL stops at its energy without the rotation term or after 5 iterations.

    Differences from Open3D's "Smoothed": Gauss-Seidel instead of Jacobi sweeps, half the weight on boundary
    edges, each cotangent clamped instead of their mean, smoothing from the first iteration. Open3D's default
    alpha of 0.01 with its factor of 2 gives the same term.

    Parameters
    ----------
    task : DeformationTask
        The mesh may have a boundary and several components, each with a handle.
    alpha : float
        Weight of the rotations' smoothness. 0 gives ARAP; large values give one rotation for all vertices.
    clamp : bool
        Raise negative cotangents to zero, as CGAL does. Without clamping, the energy can be negative where
        angles are obtuse.
    accelerate : bool
        Use Anderson acceleration, which the paper does not use. Use a tolerance of 1e-6 with it: 1e-5 stops
        it before the fixed point on fine meshes.
    tolerance : float
        Residual below which the iteration stops. It is the largest move of a vertex divided by the diagonal,
        or the largest change of a unit quaternion if that is larger. On fine meshes, positions nearly stop
        long before the rotations have spread. 0 disables the test.
    max_iterations : int
        Maximum number of iterations; the paper uses 1000.
    start : {"rest", "rigid"}
        See :func:`sshade.solver.aim.initial_guess`.
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
        If the start is unknown, alpha is negative or infinite, a handle is soft, or a component has no
        handle.
    """
    if not 0 <= alpha < np.inf:
        raise InputError(f"alpha={alpha!r} is out of range; use a finite number of at least 0")
    watch = Stopwatch()
    mesh, handles = task.mesh, task.handles
    require_hard(handles, "ARAP-SR")
    mesh.require_handles(handles.index)
    U = initial_guess(task, start)
    R0 = rigid_motion(mesh.V[handles.index], handles.target)[0] if start == "rigid" else np.eye(3)
    colour = vertex_colours(mesh)
    # Sort vertices by colour, and within a colour so that neighbours are close in memory.
    order = np.lexsort((band_position(mesh), colour))
    position = np.argsort(order)
    cells = Cells(Mesh(mesh.V[order], position[mesh.F]), alpha=alpha, clamp=clamp, colour=colour[order])
    linear = Factorised(cells.laplacian, position[handles.index])
    watch.end("precompute")

    state = _State(cells, linear, R0, U[order], accelerate=accelerate, diagonal=mesh.diagonal)
    done = run(state, Stop(tolerance, max_iterations), progress=progress)
    watch.end("solve")
    extra = {
        "rotations": state.R.reshape(-1, 3, 3)[position],
        "restarts": state.restarts,
        "colours": int(colour.max()) + 1,
    }
    return iterated(state.u[position], done, watch.seconds, extra)


class _State(Plain):
    """Positions and rotations under local and global steps.

    The acceleration mixes positions and quaternions as one vector. Rotations are unknowns too, because a
    sweep fits them to the previous rotations as well as to the positions. Plain iterations lower the energy
    of :mod:`baselines.arap_sr.arap_sr` until they are near the fixed point. If an accelerated iterate raises
    it by more than the ratio :data:`RISE`, the plain iterate is used and the history dropped. Without this
    check, a bar that is twisted by 135 degrees ends in a fixed point of ten times the energy.

    Attributes
    ----------
    Q : (n, 4) float64
    R : (n, 9) float64
        The rotations as unit quaternions and as matrices.
    restarts : int
        Number of times that the acceleration dropped its history.
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
        self._mixer = Anderson(7 * len(u), WINDOW) if accelerate else None
        self._energy, self.restarts = np.inf, 0

    def _iterate(self, u: np.ndarray, out: np.ndarray) -> None:
        self._before[:] = self.Q
        self._cells.fit(u, self.Q, self.R)
        self._cells.elements.forces(u, self.R, self._B, 0, len(u))
        self._linear.solve(self._B, out)
        out += u

    def step(self) -> float:
        """Return the residual: the largest move of a vertex, or of a rotation as a unit quaternion."""
        return max(super().step(), largest_turn(self.Q, self._before))

    def move(self, *, last: bool) -> None:
        """Go on to the plain iterate, or to an accelerated one, rotations included."""
        if last or self._mixer is None:
            super().move(last=last)
            return
        diagonal = self._diagonal
        x = np.concatenate([self.u.ravel() / diagonal, self._before.ravel()])
        g = np.concatenate([self.g.ravel() / diagonal, self.Q.ravel()])
        self._mixer.advance(x, g)
        energy = self._energy_at(x)
        if energy > RISE * self._energy:
            self.restarts += 1
            self._mixer = Anderson(len(g), WINDOW)
            energy = self._energy_at(g)
        self._energy = energy

    def _energy_at(self, x: np.ndarray) -> float:
        """Go to positions, as fractions of the diagonal, and quaternions; return the energy there."""
        n = len(self.u)
        self.u[:] = self._diagonal * x[: 3 * n].reshape(n, 3)
        self.Q[:] = x[3 * n :].reshape(n, 4)
        matrices(self.Q, self.R)
        return self._cells.energy(self.u, self.R)

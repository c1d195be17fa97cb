"""Stable Neo-Hookean elasticity on coarse tetrahedra: a quasi-static simulation.

    E = sum_t v_t psi(D_t) + w / (2 k) sum_i |(C p)_i - target_i|^2

psi is the energy of Smith et al. for a shear modulus of 1, D_t the deformation gradient of tetrahedron t, and
v_t its fraction of the volume. C holds the barycentric coordinates of the k handle vertices. Lengths are
divided by the diagonal, so w has no unit. Handles are soft and need not reach their targets. The targets move
to their places in load steps. After each step, Newton's method with definite element Hessians and a line
search finds the equilibrium. simkit provides energies and derivatives. There are no dynamics, no contact and
no gravity.

Proof: a closed form, by which a stretched body thins by Poisson's ratio; derivatives are those of the energy,
and no force is left at the end (tests/baselines/test_neo_hookean.py).

B. Smith, F. de Goes, T. Kim, "Stable Neo-Hookean flesh simulation", 2018.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, Unpack

import numpy as np
from scipy.sparse import csc_array, csr_array, eye_array, kron

from baselines.hard_handles import require_hard
from baselines.iteration import handle_error, start_motion
from baselines.stopwatch import Stopwatch
from baselines.volumetric.coarse_tetrahedra import CoarseTetrahedra, TetrahedraOptions, coarse_tetrahedra
from baselines.volumetric.node_handles import require_handles
from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.problem.options import Start
from sshade.problem.task import DeformationResult, DeformationTask
from sshade.solver.factorisation import Factorisation

#: Least decrease of a step of the line search, as a fraction of the decrease that the slope predicts.
DECREASE = 1e-4
#: Maximum number of halvings in a line search.
HALVINGS = 30
#: Least tolerance of all load steps except the last one.
INTERMEDIATE_TOLERANCE = 1e-3


def neo_hookean(
    task: DeformationTask,
    *,
    poisson: float = 0.45,
    handle_weight: float = 1000.0,
    load_steps: int = 4,
    tolerance: float = 1e-5,
    max_iterations: int = 100,
    start: Start = "rest",
    seed: int = 0,
    progress: Progress = silent,
    **options: Unpack[TetrahedraOptions],
) -> DeformationResult:
    """Deform as an elastic body with soft handles.

    Parameters
    ----------
    task : DeformationTask
        The mesh must be closed.
    poisson : float
        Poisson's ratio, in (0, 0.5). Values near 0.5 preserve the volume.
    handle_weight : float
        w, positive. Larger values bring handles nearer to their targets.
    load_steps : int
        Number of steps in which the targets move from the start to their places. Raise it if large motions
        invert tetrahedra.
    tolerance : float
        Length of a Newton step below which the iteration stops: the largest move of a node divided by the
        mesh's diagonal.
    max_iterations : int
        Maximum number of Newton steps in each load step.
    start : {"rest", "rigid"}
    seed : int
        Unused: the method is deterministic.
    progress : Progress
    **options
        Size of the tetrahedra: see :class:`baselines.volumetric.coarse_tetrahedra.TetrahedraOptions`.

    Returns
    -------
    DeformationResult
        ``extra`` has ``nodes``, ``tetrahedra``, ``tetrahedra_seconds``, ``residual``, the ``energy`` minus
        the energy at rest, the number of ``inverted`` tetrahedra, and ``handle_error``, the mean distance of
        handles to their targets divided by the diagonal.

    Raises
    ------
    ImportError
        If pytetwild or simkit is not installed.
    InputError
        If :func:`baselines.volumetric.coarse_tetrahedra.coarse_tetrahedra` refuses the mesh, a parameter is
        out of range, the start is unknown, a handle is soft, or a component of the tetrahedra has no handle.
    """
    if not 0 < poisson < 0.5 or not 0 < handle_weight < np.inf or load_steps < 1:
        raise InputError(
            f"poisson={poisson!r}, handle_weight={handle_weight!r} and load_steps={load_steps!r}: the first "
            "must lie between 0 and 0.5, the second be above 0, the third 1 or more"
        )
    mesh, handles = task.mesh, task.handles
    require_hard(handles, "Neo-Hookean elasticity")
    R, t = start_motion(task, start)
    watch = Stopwatch()
    simkit = _simkit()
    tetrahedra = coarse_tetrahedra(mesh, **options)
    carry = tetrahedra.carry[handles.index]
    require_handles(tetrahedra.component, np.unique(carry.indices))
    centre, scale = mesh.V.mean(axis=0), mesh.diagonal
    problem = Elasticity(
        tetrahedra, carry, simkit, centre=centre, scale=scale, poisson=poisson, weight=handle_weight
    )
    x = (tetrahedra.V @ R.T + t - centre) / scale
    first, target = carry @ x, (handles.target - centre) / scale
    watch.end("precompute")

    residuals: list[float] = []
    for step in range(1, load_steps + 1):
        load = step / load_steps
        problem.target = (1 - load) * first + load * target
        enough = tolerance if step == load_steps else max(tolerance, INTERMEDIATE_TOLERANCE)
        x, moves = newton(problem, x, tolerance=enough, max_iterations=max_iterations)
        residuals += moves
        progress("load steps", step, load_steps, f"residual {moves[-1] if moves else np.inf:.1e}")
    watch.end("solve")
    nodes = x * scale + centre
    V = tetrahedra.carry @ nodes
    inverted = tetrahedra.inverted(nodes)
    residual = residuals[-1] if residuals else np.inf
    watch.end("carry")
    return DeformationResult(
        vertices=V,
        iterations=len(residuals),
        converged=residual < tolerance,
        seconds=watch.seconds,
        extra={
            **tetrahedra.facts(),
            "residual": residual,
            "energy": problem.energy(x) - problem.rest,
            "inverted": inverted,
            "handle_error": handle_error(mesh, handles, V),
        },
    )


def _simkit() -> tuple[Callable[..., Any], Any]:
    """Return simkit's deformation Jacobian and its module of stable Neo-Hookean energies."""
    with warnings.catch_warnings():
        # simkit warns about optional packages that are not installed.
        warnings.simplefilter("ignore", UserWarning)
        from simkit.deformation_jacobian import deformation_jacobian
        from simkit.energies import stable_neo_hookean
    return deformation_jacobian, stable_neo_hookean


class Elasticity:
    """The energy of the module's docstring times the number of tetrahedra, at node positions x (p, 3).

    simkit raises the eigenvalues of weighted element Hessians to at least 1e-6. The weights therefore have a
    mean of 1, so that this floor is small.

    Parameters
    ----------
    tetrahedra : CoarseTetrahedra
    carry : (k, p) sparse float64
        C.
    simkit : tuple
        See :func:`_simkit`.
    centre, scale
        Origin and unit of length of x.
    poisson : float
        Poisson's ratio.
    weight : float
        w.

    Attributes
    ----------
    target : (k, 3) float64
    rest : float
        The energy at rest with the handles on their targets.
    """

    def __init__(
        self,
        tetrahedra: CoarseTetrahedra,
        carry: csr_array,
        simkit: tuple[Callable[..., Any], Any],
        *,
        centre: np.ndarray,
        scale: float,
        poisson: float,
        weight: float,
    ) -> None:
        X, count = (tetrahedra.V - centre) / scale, len(tetrahedra.T)
        jacobian, self._material = simkit
        self._carry = carry
        self._stiffness = weight * count / carry.shape[0]
        self._pull = csc_array(kron(self._stiffness * (carry.T @ carry), eye_array(3)))
        weights = tetrahedra.volumes / tetrahedra.volumes.mean()
        mu, lam = lame(poisson)
        self._constants = (
            jacobian(X, tetrahedra.T),
            *(np.full((count, 1), mu), np.full((count, 1), lam), weights[:, None]),
        )
        self.target = carry @ X
        self.rest = self.energy(X)

    def energy(self, x: np.ndarray) -> float:
        gap = self._carry @ x - self.target
        elastic = self._material.stable_neo_hookean_energy_x(x, *self._constants)
        return elastic + 0.5 * self._stiffness * float((gap**2).sum())

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """Return the gradient (p, 3) at x."""
        gap = self._carry @ x - self.target
        elastic = self._material.stable_neo_hookean_gradient_x(x, *self._constants)
        return elastic.reshape(-1, 3) + self._stiffness * (self._carry.T @ gap)

    def hessian(self, x: np.ndarray) -> csc_array:
        """Return the Hessian (3p, 3p) at x, made positive definite."""
        return csc_array(self._material.stable_neo_hookean_hessian_x(x, *self._constants)) + self._pull


def lame(poisson: float) -> tuple[float, float]:
    """Return mu and lambda of the stable energy for a shear modulus of 1 and this Poisson's ratio.

    Smith et al. multiply the linear mu by 4/3 and add 5/6 of the linear mu to the linear lambda.
    """
    return 4 / 3, 2 * poisson / (1 - 2 * poisson) + 5 / 6


def newton(
    problem: Elasticity, x: np.ndarray, *, tolerance: float, max_iterations: int
) -> tuple[np.ndarray, list[float]]:
    """Minimise the energy from x (p, 3) and return the minimum and the length of each full Newton step.

    The length of a step is the largest move of a node.

    Raises
    ------
    FloatingPointError
        If a Hessian is not positive definite.
    """
    moves: list[float] = []
    energy = problem.energy(x)
    while len(moves) < max_iterations and not (moves and moves[-1] < tolerance):
        gradient = problem.gradient(x)
        step = -Factorisation(problem.hessian(x)).solve(gradient.reshape(-1, 1)).reshape(-1, 3)
        slope = float((step * gradient).sum())
        moves.append(float(np.linalg.norm(step, axis=1).max()))
        length = 1.0
        for _ in range(HALVINGS):
            trial = x + length * step
            lower = problem.energy(trial)
            if lower <= energy + DECREASE * length * slope:
                x, energy = trial, lower
                break
            length /= 2
        else:  # rounding errors prevent a further decrease
            break
    return x, moves

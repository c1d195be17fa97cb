"""Stable Neo-Hookean elasticity on coarse tetrahedra, quasi-static: what simulation would do.

    E = sum_t v_t psi(D_t) + w / (2 k) sum_i |(C p)_i - target_i|^2

with psi the energy of Smith et al. for a shear modulus of 1, D_t the deformation gradient of tetrahedron t,
v_t its share of the volume, C the barycentric coordinates of the k handle vertices; lengths are over the
diagonal, so that w has no unit. Handles are soft and stay where the balance leaves them. They are led to
their targets in steps; after each, Newton's method with definite element Hessians and a line search goes to
rest. Energies and derivatives are simkit's, the rest is ours: no dynamics, no contact, no gravity.

B. Smith, F. de Goes, T. Kim, "Stable Neo-Hookean flesh simulation", 2018.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from time import perf_counter
from typing import Any, NamedTuple, Unpack

import numpy as np
from scipy.sparse import csc_array, csr_array, eye_array, kron

from baselines.start_motion import start_motion
from baselines.volumetric.coarse_tetrahedra import CoarseTetrahedra, TetrahedraOptions, coarse_tetrahedra
from baselines.volumetric.node_handles import handle_error, require_handles
from sshade.errors import InputError
from sshade.progress import Progress, silent
from sshade.solver.factorisation import Factorisation
from sshade.solver.options import Start
from sshade.task import DeformationResult, DeformationTask

#: Share of the decrease that the slope promises with which a step of the line search is taken, and halvings.
DECREASE, HALVINGS = 1e-4, 30
#: Residual (x diagonal) of all load steps but the last, where that asks for less.
ON_THE_WAY = 1e-3


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
    """Deform as an elastic body whose handles are pulled; handles are soft.

    Parameters
    ----------
    task : DeformationTask
        Its mesh must be closed.
    poisson : float
        Poisson's ratio, in (0, 0.5): near 0.5 the volume is kept.
    handle_weight : float
        w, above 0.
    load_steps : int
        In how many steps targets go from the start to where they are.
    tolerance : float
        Newton step, the largest move of a node over the mesh's diagonal, under which iteration stops.
    max_iterations : int
        Newton steps of each load step.
    start : {"rest", "rigid"}
    seed : int
        Unused: the method is deterministic.
    progress : Progress
    **options
        See :class:`baselines.volumetric.coarse_tetrahedra.TetrahedraOptions`.

    Returns
    -------
    DeformationResult
        ``extra`` has ``nodes``, ``tetrahedra``, ``tetrahedra_seconds``, ``residual``, the ``energy`` above
        rest, the number of ``inverted`` tetrahedra, and ``handle_error``, the mean distance to targets over
        the diagonal.

    Raises
    ------
    ImportError
        When pytetwild or simkit is not installed.
    InputError
        As of :func:`baselines.volumetric.coarse_tetrahedra.coarse_tetrahedra`, on parameters out of
        range, an unknown start or soft handles, or when tetrahedra hang together without a handle.
    """
    if not 0 < poisson < 0.5 or not 0 < handle_weight < np.inf or load_steps < 1:
        raise InputError(
            f"poisson={poisson!r}, handle_weight={handle_weight!r} and load_steps={load_steps!r}: the first "
            "must lie between 0 and 0.5, the second be above 0, the third 1 or more"
        )
    mesh, handles = task.mesh, task.handles
    handles.require_hard("Neo-Hookean elasticity")
    R, t = start_motion(task, start)
    begin = perf_counter()
    material = _energies()
    tetrahedra = coarse_tetrahedra(mesh, **options)
    carry = tetrahedra.carry[handles.index]
    require_handles(tetrahedra.component, np.unique(carry.indices))
    centre, scale = mesh.V.mean(axis=0), mesh.diagonal
    problem = Elasticity(
        tetrahedra, carry, material, centre=centre, scale=scale, poisson=poisson, weight=handle_weight
    )
    x = (tetrahedra.V @ R.T + t - centre) / scale
    first, target = carry @ x, (handles.target - centre) / scale
    precomputed = perf_counter()

    residuals: list[float] = []
    for step in range(1, load_steps + 1):
        share = step / load_steps
        problem.target = (1 - share) * first + share * target
        own = tolerance if step == load_steps else max(tolerance, ON_THE_WAY)
        x, moves = newton(problem, x, tolerance=own, max_iterations=max_iterations)
        residuals += moves
        progress("load steps", step, load_steps, f"residual {moves[-1] if moves else np.inf:.1e}")
    solved = perf_counter()
    nodes = x * scale + centre
    V = tetrahedra.carry @ nodes
    inverted = np.linalg.det(nodes[tetrahedra.T[:, 1:]] - nodes[tetrahedra.T[:, :1]]) <= 0
    residual = residuals[-1] if residuals else np.inf
    return DeformationResult(
        vertices=V,
        iterations=len(residuals),
        converged=residual < tolerance,
        seconds={
            "precompute": precomputed - begin,
            "solve": solved - precomputed,
            "carry": perf_counter() - solved,
        },
        extra={
            **tetrahedra.facts(),
            "residual": residual,
            "residual_curve": np.array(residuals),
            "energy": problem.energy(x) - problem.rest,
            "inverted": int(inverted.sum()),
            "handle_error": handle_error(mesh, handles, V),
        },
    )


class _Energies(NamedTuple):
    """simkit's functions of positions (p, 3), the deformation Jacobian, mu, lambda and weights (t, 1)."""

    jacobian: Callable[..., Any]
    energy: Callable[..., Any]
    gradient: Callable[..., Any]
    hessian: Callable[..., Any]


def _energies() -> _Energies:
    try:
        with warnings.catch_warnings():
            # It tells of extras of its own that are not installed.
            warnings.simplefilter("ignore", UserWarning)
            from simkit.deformation_jacobian import deformation_jacobian
            from simkit.energies import stable_neo_hookean as snh
    except ImportError as error:
        raise ImportError("neo_hookean needs simkit; pip install 'sshade[neo_hookean]'") from error
    return _Energies(
        deformation_jacobian,
        snh.stable_neo_hookean_energy_x,
        snh.stable_neo_hookean_gradient_x,
        snh.stable_neo_hookean_hessian_x,
    )


class Elasticity:
    """The energy of the module's docstring, times the number of tetrahedra, at node positions x (p, 3).

    simkit lifts the eigenvalues of weighted element Hessians to 1e-6: a mean weight of 1 makes that small.

    Parameters
    ----------
    tetrahedra : CoarseTetrahedra
    carry : (k, p) sparse float64
        C.
    material : _Energies
    centre, scale
        Origin and unit of length of x.
    poisson, weight : float

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
        material: _Energies,
        *,
        centre: np.ndarray,
        scale: float,
        poisson: float,
        weight: float,
    ) -> None:
        X, count = (tetrahedra.V - centre) / scale, len(tetrahedra.T)
        self._carry, self._material = carry, material
        self._stiffness = weight * count / carry.shape[0]
        self._pull = csc_array(kron(self._stiffness * (carry.T @ carry), eye_array(3)))
        share = tetrahedra.volumes / tetrahedra.volumes.mean()
        mu, lam = lame(poisson)
        given = np.full((count, 1), mu), np.full((count, 1), lam), share[:, None]
        self._given = (material.jacobian(X, tetrahedra.T), *given)
        self.target = carry @ X
        self.rest = self.energy(X)

    def energy(self, x: np.ndarray) -> float:
        gap = self._carry @ x - self.target
        return self._material.energy(x, *self._given) + 0.5 * self._stiffness * float((gap**2).sum())

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """(p, 3)"""
        gap = self._carry @ x - self.target
        return self._material.gradient(x, *self._given).reshape(-1, 3) + self._stiffness * (
            self._carry.T @ gap
        )

    def hessian(self, x: np.ndarray) -> csc_array:
        """(3p, 3p), positive definite."""
        return csc_array(self._material.hessian(x, *self._given)) + self._pull


def lame(poisson: float) -> tuple[float, float]:
    """mu and lambda of the stable energy that in small strains has a shear modulus of 1 and this ratio.

    Smith et al. take 4/3 of the linear mu, and the linear lambda with 5/6 of that mu; simkit leaves this to
    its user.
    """
    return 4 / 3, 2 * poisson / (1 - 2 * poisson) + 5 / 6


def newton(
    problem: Elasticity, x: np.ndarray, *, tolerance: float, max_iterations: int
) -> tuple[np.ndarray, list[float]]:
    """Minimise from x (p, 3); also return the largest move of a node that each full Newton step asked for.

    Raises
    ------
    FloatingPointError
        When a Hessian is not positive definite.
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
        else:  # rounding leaves nothing to win
            break
    return x, moves

"""Joints: the second solve, which holds the parts that hardly strain and makes joints round.

Softened triangles concentrate bending in hinges. That finds the pose, but a hinge in a surface is a fold, and
swallows what is inside of it. The second solve therefore holds the parts between the joints where the first
one has put them, and solves the joints again as a thick solid: without softening, and with struts between
opposite vertices (:mod:`sshade.solver.terms.struts`).

The strain of a vertex is the mean of ``max(|s1 - 1|, |s2 - 1|)`` over its triangles by area, with the
singular values s1, s2. The distance of vertex i from the joints is

    d_i = min_j |v_i - v_j| / diagonal + (MARGIN + BAND) (1 - q_j),

where q_j rises from 0 to 1 with the strain of vertex j between the limits :data:`STRAINED`. Nothing is held
up to the distance :data:`MARGIN`, and in a band behind it the hold rises to 1. A held vertex i is pulled to
its place with the stiffness ``HOLD hold_i a_i / (A s)``, where a_i is its area, A the area of the mesh, and s
the largest ``1 - hold_i``. All of this is continuous, so that a shape does not jump while targets move: where
joints begin to strain, everything is held stiffly.

The folds of the first solve are local minima. The second one therefore starts from smooth joints: rotations
of the held parts are continued into the joints, and one global step gives positions.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sshade.core.kernels import kernel
from sshade.mesh.boxes import distances
from sshade.mesh.mesh import Mesh
from sshade.mesh.rotations import fit_rotations, quaternions
from sshade.problem.handles import Handles
from sshade.problem.options import Options, Stop
from sshade.solver.aim import Aim, largest_pressures
from sshade.solver.constraints import ConstraintReport, enclosed_volume
from sshade.solver.local_global import solve
from sshade.solver.solution import Solution
from sshade.solver.system import System

#: Strains of a vertex at which a joint begins, and from which on it is one.
STRAINED = 0.04, 0.06
#: Distance from joints within which nothing is held, and width of the band in which the hold rises, as
#: fractions of the diagonal.
MARGIN, BAND = 0.015, 0.02
#: Stiffness of the hold of a whole surface, without unit.
HOLD = 100.0
#: Tolerance of the second solve, as a multiple of the method's.
TOLERANCE = 5.0


def hold(mesh: Mesh, P: np.ndarray) -> np.ndarray | None:
    """Return (n,) how firmly each vertex is held, from 0 to 1, at positions P (n, 3); None without joints."""
    strain = np.zeros(mesh.n)
    _strain(mesh.V, mesh.F, P, strain)
    begin, end = STRAINED
    some = np.flatnonzero(strain > begin)
    if len(some) == 0:
        return None
    offsets = (MARGIN + BAND) * (1.0 - np.minimum((strain[some] - begin) / (end - begin), 1.0))
    distance = distances(mesh.V / mesh.diagonal, mesh.V[some] / mesh.diagonal, offsets)
    x = np.clip((distance - MARGIN) / BAND, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


def pulls(mesh: Mesh, held: np.ndarray) -> np.ndarray:
    """Return the stiffness (n,) with which vertices are pulled to their places."""
    return HOLD * held * mesh.vertex_areas / (mesh.area * (1.0 - held.min()))


def with_round_joints(
    mesh: Mesh,
    handles: Handles,
    pose: Solution,
    options: Options,
    *,
    volume_goal: float,
    stop: Stop,
    workers: int,
) -> Solution:
    """Make the joints of a pose round; return the pose itself where nothing strains.

    Parameters
    ----------
    mesh : Mesh
        Rest shape.
    handles : Handles
        At their targets.
    pose : Solution
        Of the first solve.
    options : Options
        `joints` is the weight of the thickness; `volume`, `area` and `bending` are as in the first solve.
    volume_goal : float
        As in the first solve.
    stop : Stop
        The tolerance is that of the first solve, the number of iterations that of both solves.
    workers : int
        Threads; no influence on the result.
    """
    assert pose.rotations is not None
    left = int(stop.max_iterations - pose.iterations)
    held = hold(mesh, pose.positions)
    if left <= 0 or mesh.area == 0.0 or held is None or held.min() == 1.0:
        return pose
    stiffness = pulls(mesh, held)
    stiffness[handles.index] = 0.0
    own = np.flatnonzero(stiffness)
    solid = replace(options, stiffness=1.0, thickness=options.joints)
    most_volume, most_area = largest_pressures(mesh, handles, options)
    # A volume that has yielded stays as it is; so does an area, as a weight keeps nearly.
    states = pose.constraints
    if states.volume_constraint == "yielding":
        F, V = mesh.F.astype(np.uint32), pose.positions
        volume_goal = enclosed_volume(V, F) / enclosed_volume(mesh.V, F)
    if states.area_constraint == "yielding":
        solid = replace(solid, area=0.0)
    system = System(
        mesh,
        np.concatenate([handles.index, own]),
        solid,
        stiffness=np.concatenate([handles.stiffness, stiffness[own]]),
        with_struts=held < 1.0,
    )
    targets = np.concatenate([handles.target, pose.positions[own]])
    found = solve(
        system,
        Aim(
            targets,
            handles.prescribed_rotations,
            volume_goal=volume_goal,
            pressure=(most_volume / options.stiffness, most_area / options.stiffness),
        ),
        solid,
        start=pose.positions,
        turned=smooth_rotations(system, pose.rotations),
        stop=Stop(TOLERANCE * stop.tolerance, left),
        workers=workers,
    )
    return replace(
        found,
        iterations=pose.iterations + found.iterations,
        converged=pose.converged and found.converged,
        coarser_iterations=pose.coarser_iterations,
        constraints=_states(pose.constraints, found.constraints),
    )


def _states(pose: ConstraintReport, found: ConstraintReport) -> ConstraintReport:
    """Return the states of the second solve, where constraints did not yield in the first one."""
    if pose.volume_constraint == "yielding":
        found = found._replace(
            volume_error=pose.volume_error,
            volume_constraint=pose.volume_constraint,
            volume_pressure=pose.volume_pressure,
        )
    if pose.area_constraint == "yielding":
        found = found._replace(
            area_error=pose.area_error,
            area_constraint=pose.area_constraint,
            area_pressure=pose.area_pressure,
        )
    return found


def smooth_rotations(system: System, rotations: np.ndarray) -> np.ndarray:
    """Return rotations (n, 3, 3), in the solver's order, that are smooth where nothing is pulled.

    They are the solution X of ``(L + K) X = K R`` for the stiffness K of pulls, with R at hard handles, and
    made rotations again.
    """
    ordered, handles = system.ordered, system.handles
    n, R, fixed, pulled = system.mesh.n, rotations[ordered.vertex], handles.fixed, handles.pulled
    known, B = np.zeros((n, 9)), np.zeros((n, 9))
    known[fixed] = R[fixed].reshape(-1, 9)
    B[pulled] = handles.stiffness[:, None] * R[pulled].reshape(-1, 9)
    B -= (ordered.laplacian @ known[ordered.place])[ordered.vertex]
    X, factorised = np.empty((3, n, 3)), system.factorised
    assert factorised is not None
    for row in range(3):
        factorised.solve(np.ascontiguousarray(B[:, 3 * row : 3 * row + 3]), X[row])
    # The fit maximises tr(R S), so that S is the transpose.
    S = np.ascontiguousarray(X.transpose(1, 2, 0)).reshape(n, 9)
    S[fixed] = R[fixed].transpose(0, 2, 1).reshape(-1, 9)
    fit_rotations(S, quaternions(R)[0])
    return S.reshape(n, 3, 3)


@kernel
def _strain(V, F, P, strain):
    """Write the strain (n,) of each vertex."""
    weight = np.zeros(len(V))
    for t in range(len(F)):
        i, j, k = F[t, 0], F[t, 1], F[t, 2]
        e = f = g = a = b = c = 0.0
        for d in range(3):
            u, v = V[j, d] - V[i, d], V[k, d] - V[i, d]
            x, y = P[j, d] - P[i, d], P[k, d] - P[i, d]
            e += u * u
            f += u * v
            g += v * v
            a += x * x
            b += x * y
            c += y * y
        square = e * g - f * f
        if square <= 0.0:
            continue
        # Half the trace and the determinant of the second metric in terms of the first.
        half, product = 0.5 * (a * g - 2.0 * b * f + c * e) / square, max(a * c - b * b, 0.0) / square
        root = np.sqrt(max(half * half - product, 0.0))
        low, high = np.sqrt(max(half - root, 0.0)), np.sqrt(half + root)
        area = np.sqrt(square)
        value = area * max(abs(low - 1.0), abs(high - 1.0))
        for corner in (i, j, k):
            strain[corner] += value
            weight[corner] += area
    for i in range(len(V)):
        if weight[i] > 0.0:
            strain[i] /= weight[i]

"""Pose transfer and isometric reconstruction: poses that are known at the samples."""

from __future__ import annotations

from itertools import count
from time import perf_counter
from typing import Any

import numpy as np

from sshade.carry.binding import Binding
from sshade.mesh.mesh import Mesh, require_mesh
from sshade.mesh.surface import cut_surface, mean_of_copies
from sshade.options import PROXIES, TRANSFER_SAMPLINGS, Options, checked, takes_options
from sshade.pipeline.proxies import Proxies, bind
from sshade.progress import Progress, silent
from sshade.task import DeformationResult, TransferTask
from sshade.threads import in_threads


@takes_options(PROXIES)
def transfer(
    task: TransferTask,
    *,
    residual: bool = False,
    progress: Progress = silent,
    **options: Any,
) -> DeformationResult:
    """Transfer a pose: move an edited shape S as M moves to its pose M'.

    A proxy N is sampled on M, and its posed positions N' are read off M'. The vertices of S get coordinates
    in the frames of N, and positions from the frames of N'. Nothing is solved.

    Parameters
    ----------
    task : TransferTask
        `mesh` is S, `rest` is M and `posed` is M'. If M is no oriented manifold, it is cut, and joined again.
    residual : bool
        Add to each vertex the difference between M' and its reconstruction from the proxy.
        Vertices that were not edited then end exactly on M'. This reads M' at every vertex, and is not in the
        paper. Without it, only the samples of M' are used.
    progress : Progress
    **options
        See the options :data:`sshade.options.PROXIES` of :class:`sshade.options.Options`.
        By default 10 samplings, as in the paper.

    Returns
    -------
    DeformationResult
        S', with ``seconds`` summed over samplings.

    Raises
    ------
    InputError
        If M cannot be cut, or on an unknown option or a value out of its range.

    References
    ----------
    F. Maggioli, D. Baieri, Z. Laehner, S. Melzi, "SShaDe: scalable shape
    deformation via local representations", the sections on isometric and pose transfer.
    """
    shape = None if task.mesh.V is task.rest.V else task.mesh.V
    transfer = PoseTransfer(task.rest, shape, residual=residual, keep=False, progress=progress, **options)
    return transfer(task.posed, progress=progress).of(task)


class PoseTransfer:
    """Transfers many poses of one mesh, which is bound to its proxies once.

    Parameters
    ----------
    rest : Mesh
        M.
    edited : (n, 3) float64, optional
        S, in correspondence with M; by default M itself.
    residual : bool
        See :func:`transfer`.
    keep : bool
        Keep the bindings between calls. Without it, each call binds anew and needs less memory.
    progress : Progress
        Of the bindings, if they are kept.
    **options
        See :func:`transfer`.

    Raises
    ------
    InputError
        See :func:`transfer`.
    """

    def __init__(
        self,
        rest: Mesh,
        edited: np.ndarray | None = None,
        *,
        residual: bool = False,
        keep: bool = True,
        progress: Progress = silent,
        **options: Any,
    ) -> None:
        require_mesh(rest, "a pose transfer")
        self._cut, self._whole, self._residual = cut_surface(rest), rest, residual
        self._rest = self._cut.mesh
        self._edited = self._rest.V
        if edited is not None:
            self._edited = rest.checked(edited, "edited shape")[self._cut.origin]
        given = checked(options, PROXIES, subject="transfer")
        resolved = Options(**{"samplings": TRANSFER_SAMPLINGS, **given})
        self._proxies = Proxies(self._rest, resolved)
        self._bound: list[tuple[Binding, Any]] = []
        if keep:
            done = count(1)

            def bound(number: int) -> tuple[Binding, Any]:
                found = self._bind(number)
                progress("binding", next(done), self._proxies.samplings)
                return found

            self._bound = in_threads(bound, self._proxies.samplings, workers=self._proxies.workers)

    def _bind(self, number: int) -> tuple[Binding, Any]:
        """Bind M to a proxy; return the binding, and the coordinates of S in its frames."""
        proxies = self._proxies
        binding = bind(
            self._rest,
            proxies.vertices,
            coarser=1,
            seed=(proxies.seed, number),
            frames=proxies.frames,
            graph=proxies.graph,
        )
        local = binding.local
        if self._edited is not self._rest.V:
            local = binding.frames.encode(self._edited, binding.projection)
        return binding, local

    def __call__(self, posed: np.ndarray, *, progress: Progress = silent) -> DeformationResult:
        """Return S' for a pose M' (n, 3); see :func:`transfer`."""
        posed, done = self._whole.checked(posed, "posed shape")[self._cut.origin], count(1)

        def one_sampling(number: int) -> DeformationResult:
            kept = bool(self._bound)
            binding, local = self._bound[number] if kept else self._bind(number)
            begin = perf_counter()
            NV, on = posed[binding.sampling.samples], binding.projection
            V, degenerate = binding.frames.decode(local, NV, on=on)
            if self._residual:
                V = V + (posed - binding.frames.decode(binding.local, NV, on=on)[0])
            V = mean_of_copies(self._cut, V)
            progress("samplings", next(done), self._proxies.samplings)
            seconds = {**({} if kept else binding.seconds), "carry": perf_counter() - begin}
            return DeformationResult(V, 0, None, seconds, {"degenerate_frames": degenerate})

        progress("samplings", 0, self._proxies.samplings)
        return self._proxies.average(one_sampling)


def transfer_pose(
    mesh: Mesh,
    posed: np.ndarray,
    edited: np.ndarray | None = None,
    *,
    residual: bool = False,
    progress: Progress = silent,
    **options: Any,
) -> DeformationResult:
    """:func:`transfer` of shapes given by their vertices.

    Parameters
    ----------
    mesh : Mesh
        M.
    posed : (n, 3) float64
        M', in correspondence with M.
    edited : (n, 3) float64, optional
        S, in correspondence with M. By default M itself: the result rebuilds M' from its
        samples (isometric reconstruction), and its distance from M' is the error of the
        proxies and frames.
    residual, progress, **options
        See :func:`transfer`.
    """
    shape = mesh if edited is None else Mesh(mesh.checked(edited, "edited shape"), mesh.F)
    task = TransferTask("transfer", shape, mesh, posed)
    return transfer(task, residual=residual, progress=progress, **options)

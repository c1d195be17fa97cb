"""Bind once, deform many times: new targets only re-solve the proxies and decode."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from time import perf_counter
from typing import Any, Literal

import numpy as np

from sshade.carry.binding import Binding, bind_proxy
from sshade.errors import InputError
from sshade.mesh.mesh import Mesh
from sshade.options import ENERGY
from sshade.pipeline.bound_proxy import BoundProxy
from sshade.pipeline.fast import Choices, choices, published
from sshade.pipeline.proxies import Proxies
from sshade.pipeline.regions import HandleRegions, all_on_targets
from sshade.progress import Progress, silent
from sshade.task import DeformationResult, DeformationTask, Handles
from sshade.threads import ThreadTeam, in_threads

#: Tolerance at which a drag has settled, over the method's.
SETTLED = 0.01


class Deformer:
    """A mesh bound to its proxies, with everything that does not depend on the targets.

    Remeshes, projections, frames and factorisations are made once. The first call with given targets gives
    what the method of a task does. Each later one goes on from where the last one ended (see
    :mod:`sshade.solver.following`), so that small moves of the handles take a few iterations: a drag.
    :meth:`settle` ends it in the minimum, which is that of the method, unless the way there has led into
    another one: :meth:`reset` forgets the way. Handles come and go by :meth:`rebind_handles`, constraints by
    :meth:`change_energy`; :meth:`preview` leaves the mesh out and gives the proxy.

    Parameters
    ----------
    mesh : Mesh
        M: manifold, oriented, one component.
    index : (h,) int
        Handle vertices, each once; their targets come with each call, in this order.
    group : (h,) int, optional
        Which landmark each belongs to, as of :class:`sshade.Handles`; by default all to one.
    weight : (h,) float64 or float
        Of soft handles, see :class:`sshade.Handles`; inf by default.
    method : {"fast", "paper"}
        :func:`sshade.sshade_fast`, or :func:`sshade.sshade` with one sampling.
    progress : Progress
    **options
        Those of the method: see :class:`sshade.pipeline.fast.FastOptions`; of "paper" all that are not of
        proxies are those of its solver, by default the published ones.

    Raises
    ------
    InputError
        On a mesh or options out of the above.

    Examples
    --------
    >>> import numpy as np
    >>> from sshade import Deformer, Mesh
    >>> V = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]], dtype=float)
    >>> mesh = Mesh(V, np.array([[0, 1, 2], [0, 2, 3]]))
    >>> drag = Deformer(mesh, [0, 2], vertices=4, area=0)
    >>> for height in (0.5, 1.0):
    ...     shape = drag(V[[0, 2]] + [0, 0, height], tolerance=1e-4).vertices
    >>> shape.shape, drag.preview(V[[0, 2]]).vertices.shape
    ((4, 3), (4, 3))
    >>> drag.rebind_handles([0, 1, 2])
    >>> drag.change_energy(area=1.0)
    >>> raised = drag(V[:3] + [0, 0, 1])
    >>> bool(abs(drag.settle().vertices - V - [0, 0, 1]).max() < 1e-6)
    True
    """

    def __init__(
        self,
        mesh: Mesh,
        index: np.ndarray,
        *,
        group: np.ndarray | None = None,
        weight: np.ndarray | float = inf,
        method: Literal["fast", "paper"] = "fast",
        progress: Progress = silent,
        **options: Any,
    ) -> None:
        self.mesh = mesh
        self._take_handles(index, group, weight)
        if method not in ("fast", "paper"):
            raise InputError(f"a mesh is bound by the method 'fast' or 'paper', not {method!r}")
        self._fast, self._options = method == "fast", dict(options)
        self._choices = chosen = self._chosen()
        # The factorised systems have these, whatever handles come later.
        self._options |= {name: chosen.solver[name] for name in ("attachment", "bending")}
        self._proxies = proxies = Proxies(mesh, handles=len(self.index), **chosen.proxies)
        self._regions = regions = self._new_regions()
        self._at: Handles | None = None
        # Its threads stay: to begin and end them takes some tenths of a millisecond.
        team = ThreadTeam(proxies.carriers)

        def make(number: int) -> BoundProxy:
            remeshed, handle = regions.sample((proxies.seed, number))
            binding = bind_proxy(mesh, remeshed, frames=proxies.frames)
            on = np.flatnonzero(handle >= 0)
            bound = BoundProxy(
                binding,
                own=handle[on],
                on=on,
                rest=self._rest,
                choices=chosen,
                first="multilevel" if self._fast else "plain",
                seed=proxies.seed,
                team=team,
            )
            progress("binding", number + 1, proxies.samplings)
            return bound

        made = [] if regions.covered else in_threads(make, proxies.samplings, workers=proxies.workers)
        self._bound_proxies = made
        regions.prepare()

    @property
    def bindings(self) -> list[Binding]:
        """To each proxy."""
        return [proxy.binding for proxy in self._bound_proxies]

    def _chosen(self) -> Choices:
        task = DeformationTask("drag", self.mesh, self._rest)
        return choices(task, self._options) if self._fast else published(self._options)

    def _new_regions(self) -> HandleRegions:
        return HandleRegions(
            self.mesh, self._rest, vertices=self._proxies.vertices, graph=self._proxies.graph
        )

    def _take_handles(self, index: np.ndarray, group: np.ndarray | None, weight: np.ndarray | float) -> None:
        self.index = np.array(index, dtype=np.int64)
        self.mesh.require_handles(self.index)
        if len(np.unique(self.index)) < len(self.index):
            raise InputError("a handle vertex is given twice")
        group = np.zeros(len(self.index), dtype=np.int64) if group is None else group
        handles = Handles(self.index, self.mesh.V[self.index], group=group, weight=np.asarray(weight))
        self._rest = DeformationTask("drag", self.mesh, handles).handles

    def rebind_handles(
        self, index: np.ndarray, *, group: np.ndarray | None = None, weight: np.ndarray | float = inf
    ) -> None:
        """Take other handles, more or fewer, without sampling and projecting anew; the shape stays.

        The vertices of the proxies that are nearest to them are held in their stead, at targets that are
        corrected for the offset, as of :meth:`sshade.Handles.from_positions`, and for what hard handles
        missed in the call before. So one that was not bound from the beginning lags a little in a drag
        and is met when it settles, but for those so close to each other that they become one, which are
        met in the mean. The time is that of a factorisation of the proxy.

        Parameters
        ----------
        index, group, weight
            As for the class.

        Raises
        ------
        InputError
            On a vertex as for the class, or, then or in a call, where handles are too far from the samples,
            or those of two groups are nearest to the same one and have different targets.
        """
        self._take_handles(index, group, weight)
        self._regions, self._at = self._new_regions(), None
        for proxy in self._bound_proxies:
            proxy.take(self._rest)

    def change_energy(self, **energy: Any) -> None:
        """Take other constraints or another softening from the next call on; the shape stays where it is.

        Parameters
        ----------
        **energy
            Those that change, None for the method's own: see :data:`sshade.options.ENERGY`.

        Raises
        ------
        TypeError
            On another option.
        InputError
            On a value as there.
        """
        if unknown := set(energy) - set(ENERGY):
            raise TypeError(f"unexpected keyword argument {min(unknown)!r}: it is none of the energy")
        before, self._options = self._options, {**self._options, **energy}
        try:
            self._choices = self._chosen()
        except InputError:
            self._options = before
            raise
        for proxy in self._bound_proxies:
            proxy.change(self._choices)

    def reset(self) -> None:
        """Forget the last shape: the next call begins as the method does."""
        for proxy in self._bound_proxies:
            proxy.reset()

    def __call__(
        self,
        targets: np.ndarray,
        *,
        rotations: np.ndarray | None = None,
        tolerance: float | None = None,
        max_iterations: int | None = None,
        out: np.ndarray | None = None,
    ) -> DeformationResult:
        """Deform for new targets of the same handles, from where the last call ended.

        Parameters
        ----------
        targets : (h, 3) float64
            In the order of `index`.
        rotations : (h, 3, 3) float64, optional
            Of the handles, NaN where open; see :class:`sshade.Handles`. Other handles that have one make
            a new factorisation of the proxy.
        tolerance : float, optional
            Residual, relative to the proxy's diagonal, under which iteration stops; by default that of the
            options.
        max_iterations : int, optional
            Cutoff; a handful keeps a drag fluid, and the next call goes on. By default that of the options.
        out : (n, 3) float64, C-contiguous, optional
            Takes the vertices, which with one sampling and without regions saves a large array a
            call; the result's are these.

        Returns
        -------
        DeformationResult
            As of the method; ``seconds`` has the ``solve`` and the ``carry``, and ``extra`` the largest
            ``residual`` and the proxies' ``energy``.
        """
        return self._deformed(self._aimed(targets, rotations), tolerance, max_iterations, out)

    def settle(self, *, tolerance: float | None = None, out: np.ndarray | None = None) -> DeformationResult:
        """Go on to the minimum for the last call's targets: the end of a drag.

        A residual is one step, and a drag lags some hundred of them behind: at the method's tolerance
        up to some thousandths of the diagonal, as the method's own result is, and at a hundredth of it less
        than one.

        Parameters
        ----------
        tolerance : float, optional
            By default :data:`SETTLED` times the method's.
        out : (n, 3) float64, C-contiguous, optional

        Raises
        ------
        InputError
            Where no call has been made with these handles.
        """
        if self._at is None:
            raise InputError(
                "there is nothing to settle: no targets were given since these handles were taken"
            )
        tolerance = SETTLED * self._choices.tolerance if tolerance is None else tolerance
        return self._deformed(self._at, tolerance, None, out, settle=True)

    def preview(
        self,
        targets: np.ndarray,
        *,
        rotations: np.ndarray | None = None,
        tolerance: float | None = None,
        max_iterations: int | None = None,
    ) -> DeformationResult:
        """The first proxy alone, as a call would carry the mesh along with it: for displays, or slow ones.

        ``bindings[0].proxy`` has its triangles, ``bindings[0].sampling.samples`` the vertices of M that its
        own are. A later call goes on from here.

        Parameters
        ----------
        targets, rotations, tolerance, max_iterations
            As of a call.

        Returns
        -------
        DeformationResult
            ``vertices`` (k, 3), ``seconds`` with the ``solve``.

        Raises
        ------
        InputError
            As of a call, and where all vertices are handles.
        """
        begin, handles = perf_counter(), self._aimed(targets, rotations)
        if self._regions.covered:
            raise InputError("all vertices are handles: there is no proxy")
        solved = self._bound_proxies[0].solve(handles, **self._stop(tolerance, max_iterations))
        return replace(solved, seconds={"solve": perf_counter() - begin})

    def _aimed(self, targets: np.ndarray, rotations: np.ndarray | None) -> Handles:
        self._at = self._rest.at(targets, rotations)
        return self._at

    def _stop(self, tolerance: float | None, max_iterations: int | None) -> dict[str, Any]:
        given, own = max_iterations, self._choices
        return {
            "tolerance": own.tolerance if tolerance is None else tolerance,
            "max_iterations": own.solver["max_iterations"] if given is None else given,
        }

    def _deformed(
        self,
        handles: Handles,
        tolerance: float | None,
        max_iterations: int | None,
        out: np.ndarray | None,
        settle: bool = False,
    ) -> DeformationResult:
        if out is not None and not (
            out.shape == self.mesh.V.shape and out.dtype == np.float64 and out.flags.c_contiguous
        ):
            raise InputError(f"`out` must be a contiguous float64 array of shape {self.mesh.V.shape}")
        if self._regions.covered:
            return all_on_targets(DeformationTask("drag", self.mesh, handles))
        into, stop = out if self._proxies.samplings == 1 else None, self._stop(tolerance, max_iterations)

        def one(number: int) -> DeformationResult:
            proxy, keep = self._bound_proxies[number], self._keeps_volume
            return proxy.deform(handles, self._regions, keep_volume=keep, settle=settle, out=into, **stop)

        result = self._proxies.average(one)
        V = result.vertices
        if not self._keeps_volume:
            V = self._regions.on_targets(V, handles)
        elif self._regions.volume:
            V = self._regions.keep_volume(V)
        if out is not None and V is not out:
            out[:] = V
            V = out
        return result if V is result.vertices else replace(result, vertices=V)

    @property
    def _keeps_volume(self) -> bool:
        return self._fast and self._choices.keeps_volume

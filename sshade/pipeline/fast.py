"""Beyond the paper: one proxy that holds its volume and area, carried back with blended frames.

The proxy's triangles soften where they are strained (:mod:`sshade.solver.strain_softening`), and its
motion is blended over each of them (:mod:`sshade.carry.blended`), so that one sampling does.
"""

from __future__ import annotations

from functools import partial
from math import inf
from typing import Any, Unpack

from sshade.pipeline.components import each_component
from sshade.pipeline.multilevel import multilevel
from sshade.pipeline.paper import sshade
from sshade.pipeline.proxies import ProxyOptions
from sshade.pipeline.regions import AREA, has_regions
from sshade.solver.local_global import local_global
from sshade.solver.options import SolverOptions, complete
from sshade.task import DeformationResult, DeformationTask, Progress, silent

#: Residual stiffness of strongly strained triangles, and the strain about which they soften.
STIFFNESS, STRAIN = 0.08, 0.0125


class FastOptions(ProxyOptions, SolverOptions, total=False):
    """The options of proxies and those of their solver."""


@each_component
def sshade_fast(
    task: DeformationTask, *, progress: Progress = silent, **options: Unpack[FastOptions]
) -> DeformationResult:
    """SShaDe with one constrained proxy and blended frames.

    Parameters
    ----------
    task : DeformationTask
        As for :func:`sshade.sshade`.
    progress : Progress
    **options
        Of the proxies, by default one with ``blended`` frames: see
        :class:`sshade.pipeline.proxies.ProxyOptions`. Of their energy, the spokes and rims, and its
        iteration: see :class:`sshade.solver.options.SolverOptions`; by default volume and area are
        exact (inf), with handle regions the area has the weight
        :data:`sshade.pipeline.regions.AREA`, stiffness and strain are :data:`STIFFNESS` and
        :data:`STRAIN`, and the start is "rigid". Large proxies begin with a coarser one's result: see
        :mod:`sshade.pipeline.multilevel`.

    Returns
    -------
    DeformationResult
        As of :func:`sshade.sshade`. Volume and area are held on the proxy: those
        of the mesh come out within what the proxy's details add, about 0.05 %
        at a vertex in four.

    Raises
    ------
    InputError
        Those of :func:`sshade.sshade` and :func:`sshade.solver.local_global.local_global`.
    """
    given: dict[str, Any] = dict(options)
    of_solver = {name: given.pop(name) for name in SolverOptions.__annotations__ if name in given}
    regional = "area" not in of_solver and has_regions(task, given.get("vertices", 6000))
    area = AREA if regional else inf
    solver = complete(of_solver, volume=inf, area=area, stiffness=STIFFNESS, strain=STRAIN, start="rigid")
    tolerance = solver.pop("tolerance")
    coarse = partial(multilevel, coarse=partial(local_global, **solver), tolerance=tolerance)
    keep = solver["volume"] == inf
    given = {"samplings": 1, "frames": "blended", **given}
    return sshade(task, coarse=coarse, keep_volume=keep, progress=progress, **given)

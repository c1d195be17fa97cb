"""Beyond the paper: one proxy that holds its volume and area, carried back with blended frames.

The proxy's triangles soften where they are strained (:mod:`sshade.solver.terms.arap`), its handle
groups pull the parts that they lie on along (:mod:`sshade.solver.attachment`), and its
motion is blended over each of its triangles (:mod:`sshade.carry.blended`), so that one sampling does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from math import inf
from typing import Any, NamedTuple

from sshade.options import PROXIES, SOLVER, complete, takes_options
from sshade.pipeline.components import each_component
from sshade.pipeline.multilevel import multilevel
from sshade.pipeline.paper import sshade
from sshade.pipeline.proxies import ProxyOptions
from sshade.pipeline.regions import OF_REGIONS, has_regions
from sshade.progress import Progress, silent
from sshade.solver.local_global import local_global
from sshade.task import DeformationResult, DeformationTask

#: Vertices of the proxy.
VERTICES = 12_000
#: How strongly handle groups pull their parts along, and what is left of the stiffness under strain.
PARTS, STIFFNESS = 0.1, 0.06
#: The proxy's energy, by default.
PROXY = dict[str, Any](
    volume=inf, area=inf, attachment=PARTS, stiffness=STIFFNESS, strain=0.0125, start="rigid"
)

#: What is left of the stiffness where handles are regions: strain gathers at their edges anyway. Their parts
#: spread it from there, and more than this would stretch what lies between.
REGION_STIFFNESS = 0.08

#: Of the energy whose minimum leads: parts come first, nothing softens, and the area need not be exact.
LEAD, LEAD_AREA = dict[str, Any](attachment=3.0, stiffness=1.0), 1.0


class FastOptions(ProxyOptions, total=False):
    """The options of proxies and those of their solver."""


@takes_options((*PROXIES, *SOLVER))
@each_component(vertices=VERTICES)
def sshade_fast(task: DeformationTask, *, progress: Progress = silent, **options: Any) -> DeformationResult:
    """SShaDe with one constrained proxy and blended frames.

    Parameters
    ----------
    task : DeformationTask
        As for :func:`sshade.sshade`.
    progress : Progress
    **options
        Of the proxies, by default one of :data:`VERTICES` with ``blended`` frames: see
        :class:`sshade.pipeline.proxies.ProxyOptions`. Of their energy, the spokes and rims, and its
        iteration: see :data:`sshade.options.SOLVER`, by default :data:`PROXY`; with handle
        regions :data:`sshade.pipeline.regions.OF_REGIONS` and :data:`REGION_STIFFNESS` are among them:
        strain and folds gather at the edges of regions.
        Large proxies begin with a coarser one's result: see :mod:`sshade.pipeline.multilevel`.

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
    return with_choices(task, choices(task, options), progress=progress)


class Choices(NamedTuple):
    """What options of :func:`sshade_fast` come to.

    Attributes
    ----------
    proxies : dict
        Of the proxies.
    solver : dict
        Of their energy and its iteration, all but the tolerance.
    tolerance : float
    lead : callable, optional
        See :func:`sshade.pipeline.multilevel.multilevel`.
    """

    proxies: dict[str, Any]
    solver: dict[str, Any]
    tolerance: float
    lead: Callable[..., DeformationResult] | None

    @property
    def keeps_volume(self) -> bool:
        """Whether what proxies miss of the volume is made up for."""
        return self.solver["volume"] == inf


def choices(task: DeformationTask, options: Mapping[str, Any]) -> Choices:
    """The options of :func:`sshade_fast` for a task, with its defaults.

    Raises
    ------
    InputError
        See :func:`sshade.options.complete`.
    """
    given = dict(options)
    of_solver = {name: given.pop(name) for name in SOLVER if name in given}
    given = {"vertices": VERTICES, "samplings": 1, "frames": "blended", **given}
    regional = has_regions(task, given["vertices"])
    regions = PROXY | OF_REGIONS | dict[str, Any](stiffness=REGION_STIFFNESS)
    solver = completed(of_solver, regions if regional else PROXY)
    tolerance = solver.pop("tolerance")
    leading: dict[str, Any] = {**solver, **LEAD, "area": min(solver["area"], LEAD_AREA)}
    return Choices(
        given, solver, tolerance, partial(local_global, **leading) if solver["attachment"] else None
    )


def with_choices(task: DeformationTask, made: Choices, *, progress: Progress) -> DeformationResult:
    """:func:`sshade_fast` of one component, with these choices."""
    solver = partial(local_global, **made.solver)
    coarse = partial(multilevel, coarse=solver, lead=made.lead, tolerance=made.tolerance)
    return sshade(task, coarse=coarse, keep_volume=made.keeps_volume, progress=progress, **made.proxies)


def published(options: Mapping[str, Any]) -> Choices:
    """The choices of the paper, but for one sampling; errors as of :func:`choices`."""
    given = dict(options)
    solver = completed({name: given.pop(name) for name in SOLVER if name in given}, {})
    return Choices({"samplings": 1, **given}, solver, solver.pop("tolerance"), lead=None)


def completed(given: Mapping[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """All solver options: those given and not None, else the defaults, else the published energy."""
    own = {name: value for name, value in given.items() if value is not None}
    return complete({**defaults, **own}).subset(SOLVER)

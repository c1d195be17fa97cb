"""Facts of a deformation beside its positions, and the rules that join facts of several results."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Literal

import numpy as np

#: What is joined: the samplings of a piece, or the pieces of a mesh.
Joint = Literal["samplings", "pieces"]


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))


def _distinct(values: Sequence[str]) -> str:
    return ", ".join(dict.fromkeys(values))


def _largest(values: Sequence[float]) -> float:
    return max(values, key=abs)


def _first(values: Sequence[Any]) -> Any:
    return values[0]


def _fact(
    default: Any = None,
    *,
    samplings: Callable[[Any], Any] | None = None,
    pieces: Callable[[Any], Any] | None = None,
) -> Any:
    """Declare a fact, and how the facts of samplings and of pieces become one; None: it is dropped."""
    return field(default=default, metadata={"samplings": samplings, "pieces": pieces})


@dataclass(frozen=True)
class Facts:
    """Facts of a deformation: for notes, for rows of the evaluator, and for notebooks.

    Distances are fractions of the bounding-box diagonal. A number is 0, and another fact None, where it does
    not apply.

    Attributes
    ----------
    options : mapping
        The options as the method resolved them.
    hard_handle_error : float or None
        Largest distance of a hard handle from its target.
    volume_goal_error : float or None
        Largest relative error of the volume goal over the pieces.
    followed : bool or None
        Of a pose in a sequence: whether it started from the pose before.
    samples : int
        Number of samples of each proxy, summed over pieces.
    samplings : int
        Number of proxies of a piece.
    proxy_vertices : float
        Mean over samplings, sum over pieces.
    added_samples, degenerate_frames, faces_without_area : int
        Samples that the repair of Voronoi regions added; triangles whose frame is the mean of their
        neighbours' frames; faces of M that were slightly enlarged.
    proxy_iterations : float or None
        Iterations of the proxies, where a polish has iterations of its own.
    coarser_iterations : float or None
        Iterations on the coarser proxy in which the solve starts; 0 without one.
    residual : float or None
        Last residual, the largest over proxies. Of the polish, if there is one.
    energy : float or None
        Last energy, the mean over proxies. Of the polish, if there is one.
    volume_error, area_error : float or None
        Largest relative errors of constrained volumes and areas: of M after a polish, else of N.
    volume_pressure, area_pressure : float or None
        Multipliers of the constraints over the rest area: how hard they push, without unit.
    volume_constraint, area_constraint : str or None
        States of the constraints: see :meth:`sshade.solver.constraints.Constraints.report`.
    components : int
        Number of components that were deformed.
    rigid : int
        Components among them that moved rigidly with their handles.
    unconstrained : int
        Components without handles.
    touching : int
        Unconstrained components that touch others.
    duplicates : int
        Faces there twice that were ignored.
    one_sided : int
        Vertices on bent one-sided surfaces.
    copies : int
        Copies of vertices where the mesh was cut.
    turned : int
        Faces turned around, to agree with their neighbours.
    gap, side_gap, opening : float
        Largest distances between a copy and the joined vertex, between a side of a one-sided surface and the
        mean of its sides, and between vertices that touched at rest and are not joined.
    """

    options: Mapping[str, Any] = field(default_factory=dict, metadata={"pieces": _first})
    hard_handle_error: float | None = _fact()
    volume_goal_error: float | None = _fact(pieces=max)
    followed: bool | None = _fact()

    samples: int = _fact(0, samplings=_first, pieces=sum)
    samplings: int = _fact(0, samplings=sum)
    proxy_vertices: float = _fact(0, samplings=_mean, pieces=sum)
    added_samples: int = _fact(0, samplings=sum, pieces=sum)
    degenerate_frames: int = _fact(0, samplings=sum, pieces=sum)
    faces_without_area: int = _fact(0, samplings=_first, pieces=sum)

    proxy_iterations: float | None = _fact(pieces=_mean)
    coarser_iterations: float | None = _fact(samplings=_mean, pieces=_mean)
    residual: float | None = _fact(samplings=max, pieces=max)
    energy: float | None = _fact(samplings=_mean)
    volume_error: float | None = _fact(samplings=max, pieces=max)
    area_error: float | None = _fact(samplings=max, pieces=max)
    volume_pressure: float | None = _fact(samplings=_largest, pieces=_largest)
    area_pressure: float | None = _fact(samplings=_largest, pieces=_largest)
    volume_constraint: str | None = _fact(samplings=_distinct, pieces=_distinct)
    area_constraint: str | None = _fact(samplings=_distinct, pieces=_distinct)

    components: int = _fact(1)
    rigid: int = _fact(0)
    unconstrained: int = _fact(0)
    touching: int = _fact(0)
    duplicates: int = _fact(0)
    one_sided: int = _fact(0)
    copies: int = _fact(0)
    turned: int = _fact(0)
    gap: float = _fact(0.0)
    side_gap: float = _fact(0.0)
    opening: float = _fact(0.0)

    @classmethod
    def joined(cls, facts: Sequence[Facts], of: Joint) -> Facts:
        """Join the facts of samplings or of pieces by the rules of the fields."""
        values = {}
        for name, rule in ((fact.name, fact.metadata.get(of)) for fact in fields(cls)):
            found = [value for one in facts if (value := getattr(one, name)) is not None]
            if rule is not None and found:
                values[name] = rule(found)
        return cls(**values)

"""How facts of several results become facts of one: of samplings, and of the pieces of a mesh."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from sshade.problem.task import DeformationResult


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))


def _distinct(values: Sequence[str]) -> str:
    return ", ".join(dict.fromkeys(values))


#: How the facts of samplings are combined into a fact of their average; other facts are dropped.
OF_SAMPLINGS: Mapping[str, Callable[[Any], Any]] = {
    "proxy_vertices": _mean,
    "added_samples": sum,
    "degenerate_frames": sum,
    "residual": max,
    "energy": list,
    "proxy_energy": _mean,
    "proxy_volume_error": max,
    "proxy_area_error": max,
    "proxy_volume_constraint": _distinct,
    "proxy_area_constraint": _distinct,
    "proxy_coarser_iterations": _mean,
    "proxy_initialisation": _distinct,
}


#: How the facts of pieces are combined into a fact of the whole; other facts are dropped.
OF_PIECES: Mapping[str, Callable[[Any], Any]] = {
    "samples": sum,
    "proxy_vertices": sum,
    "faces_without_area": sum,
    "residual": max,
    "volume_goal_error": max,
    "options": lambda values: values[0],
}
#: Facts of a result without a proxy.
NO_PROXY = {"samples": 0, "proxy_vertices": 0, "residual": 0.0, "faces_without_area": 0}


def joined(
    vertices: np.ndarray,
    results: Sequence[DeformationResult],
    facts: Mapping[str, Callable[[Any], Any]],
    *,
    extra: Mapping[str, Any] | None = None,
) -> DeformationResult:
    """Join results into one: mean iterations, converged if all are, seconds summed, facts by their rules.

    Parameters
    ----------
    vertices : (n, 3) float64
    results : sequence of DeformationResult
    facts : mapping
        For each name in ``extra`` the function that combines the values of the results that have it.
    extra : mapping, optional
        Further facts.
    """
    converged = [result.converged for result in results]
    stages = dict.fromkeys(stage for result in results for stage in result.seconds)
    found = {name: [r.extra[name] for r in results if name in r.extra] for name in facts}
    return DeformationResult(
        vertices=vertices,
        iterations=_mean([result.iterations for result in results]),
        converged=None if None in converged else all(converged),
        seconds={stage: sum(r.seconds.get(stage, 0.0) for r in results) for stage in stages},
        extra={**(extra or {}), **{name: facts[name](values) for name, values in found.items() if values}},
    )

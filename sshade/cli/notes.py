"""What ``sshade deform`` says it did beside deforming: with handles, small meshes, unclean surfaces."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def notes(facts: Mapping[str, Any]) -> list[str]:
    """One sentence for each of these things that was done.

    Parameters
    ----------
    facts : mapping
        The `extra` of :func:`sshade.sshade_fast` and of
        :func:`sshade.pipeline.components.each_component`; ``asked`` samples, the
        largest ``snap`` and the ``diagonal``; and, where the mesh was not repaired, the numbers of
        vertices ``unused`` and ``doubled`` and of ``collapsed`` faces.
    """
    doubled = facts.get("doubled", 0)
    seam = f"{doubled} vertices are a second one at a place along a seam, and move with it"
    turned, copies, components = facts.get("turned", 0), facts.get("copies", 0), facts.get("components", 1)
    cut = (
        f"no oriented manifold: {turned} faces were turned, {copies} copies of vertices "
        f"made, and joined over at most {100 * facts.get('gap', 0):.2g} % of the diagonal"
    )
    unconstrained = facts.get("unconstrained", 0)
    flat, unused = facts["faces_without_area"], facts.get("unused", 0)
    dropped = facts.get("duplicates", 0) + facts.get("collapsed", 0)
    few = f"{facts['samples']} samples and not {facts['asked']}: a quarter of the vertices at most"
    found = {
        seam: doubled,
        f"handles given by position were snapped by {facts['snap']:.3g} at most, "
        f"{100 * facts['snap'] / facts['diagonal']:.2g} % of the diagonal": facts["snap"] > 0,
        few: facts["samples"] < facts["asked"],
        f"{flat} faces without area take part as slightly larger ones": flat,
        f"{dropped} faces that repeat a vertex or another face are no part of the surface": dropped,
        f"{unused} vertices that no face uses stay where they are": unused,
        "two starts ended in different shapes: the one of clearly lower energy was taken, where parts "
        "did not lead": facts.get("proxy_basin") == "start",
        cut: copies or turned,
        f"{components} components were deformed on their own, with shares of the proxy vertices": components
        > 1,
        f"{unconstrained} components without handles follow the nearest one rigidly": unconstrained,
    }
    return [note for note, holds in found.items() if holds]

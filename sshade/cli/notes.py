"""Notes of ``sshade deform`` on snapped handles, small meshes and unclean surfaces."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def notes(facts: Mapping[str, Any]) -> list[str]:
    """Return a sentence for each unusual fact.

    Parameters
    ----------
    facts : mapping
        The `extra` of the result; the `facts` of the :class:`sshade.mesh.surface.Surface`; ``asked``, the
        wanted number of samples; ``snap``, the greatest snap distance; and ``diagonal``.
    """
    doubled, unused, flat = facts.get("doubled", 0), facts.get("unused", 0), facts["faces_without_area"]
    dropped = facts.get("duplicates", 0) + facts.get("collapsed", 0)
    near = facts.get("near", 0)
    turned, copies = facts.get("turned", 0), facts.get("copies", 0)
    components, unconstrained = facts.get("components", 1), facts.get("unconstrained", 0)
    found = {
        f"{doubled} vertices share their place with another vertex, and move with it": doubled,
        f"{near} vertices lie near another vertex, within rounding, and move with it (at most "
        f"{facts.get('tolerance', 0):.2g} of the diagonal from their common place)": near,
        f"handles given by position were snapped by at most {facts['snap']:.3g}, "
        f"{100 * facts['snap'] / facts['diagonal']:.2g} % of the diagonal": facts["snap"] > 0,
        f"the proxy has {facts['samples']} vertices instead of {facts['asked']}: at most a quarter of the "
        "vertices of the mesh": facts["samples"] < facts["asked"],
        f"{flat} faces without area were slightly enlarged": flat,
        f"{dropped} faces that repeat a vertex or another face were ignored": dropped,
        f"{unused} vertices without a face stay at their places": unused,
        "the two initialisations led to different shapes: the result starts from the rigid motion, whose "
        "energy is clearly lower, and not from the guide energy": facts.get("proxy_initialisation")
        == "handles",
        f"the mesh is no oriented manifold: {turned} faces were turned around, {copies} vertices were "
        "duplicated and joined again, over gaps of at most "
        f"{100 * facts.get('gap', 0):.2g} % of the diagonal": copies or turned,
        f"{components} components were deformed separately and divide the proxy vertices": components > 1,
        f"{unconstrained} components without handles rigidly follow the nearest component": unconstrained,
    }
    return [note for note, holds in found.items() if holds]

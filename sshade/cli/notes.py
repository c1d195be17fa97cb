"""Notes of ``sshade deform`` on snapped handles, small meshes and unclean surfaces."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sshade.core.console import say
from sshade.core.errors import counted
from sshade.files.handle_files import HandleFile

#: Distance between vertices that touched, as a fraction of the diagonal, up to which they still touch.
APART = 1e-6


@contextmanager
def announced_warnings() -> Iterator[None]:
    """Print the warnings that methods log, such as a constraint that is off; each once, at once."""

    class WarningPrinter(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.getMessage() not in printed:
                printed.add(record.getMessage())
                say(f"note: {record.getMessage()}")

    printed: set[str] = set()
    logger, announcement = logging.getLogger("sshade"), WarningPrinter(logging.WARNING)
    logger.addHandler(announcement)
    try:
        yield
    finally:
        logger.removeHandler(announcement)


def notes(facts: Mapping[str, Any]) -> list[str]:
    """Return a sentence for each unusual fact.

    Parameters
    ----------
    facts : mapping
        The `extra` of the result; the `facts` of the :class:`sshade.mesh.surface.Surface`; ``asked``, the
        wanted number of samples; ``snap``, the greatest snap distance; and ``diagonal``.
    """
    doubled, near = facts.get("doubled", 0), facts.get("near", 0)
    unused, flat = facts.get("unused", 0), facts["faces_without_area"]
    dropped = facts.get("duplicates", 0) + facts.get("collapsed", 0)
    turned, copies, one_sided = (facts.get(name, 0) for name in ("turned", "copies", "one_sided"))
    rigid, unconstrained = facts.get("rigid", 0), facts.get("unconstrained", 0)
    bent = facts.get("components", 1) - rigid
    percent = {
        name: f"{100 * facts.get(name, 0):.2g} % of the diagonal" for name in ("gap", "side_gap", "opening")
    }
    found = {
        f"{doubled} vertices share their place with another vertex, and move with it": doubled,
        f"{near} vertices lie near another vertex, and move with it (at most "
        f"{facts.get('tolerance', 0):.2g} of the diagonal from their common place)": near,
        f"handles given by position were snapped by at most {facts['snap']:.3g}, "
        f"{100 * facts['snap'] / facts['diagonal']:.2g} % of the diagonal": facts["snap"] > 0,
        "the handles are dense: --method interpolate follows them without an elastic surface in between": (
            facts.get("dense", False)
        ),
        **(_on_samples(facts, components=bent) if "samples" in facts else {}),
        f"{counted(flat, 'face without area was', 'faces without area were')} slightly enlarged": flat,
        f"{counted(dropped, 'face that repeats', 'faces that repeat')} a vertex or another face "
        f"{'was' if dropped == 1 else 'were'} ignored": dropped,
        f"{counted(unused, 'vertex without a face stays', 'vertices without a face stay')} in place": unused,
        "the two initialisations led to different shapes: the result starts from the rigid motion, whose "
        "energy is clearly lower, and not from the guide energy": facts.get("proxy_initialisation")
        == "handles",
        f"{counted(turned, 'face was', 'faces were')} turned around, to agree with their neighbours": turned,
        f"the surface was cut where it is not manifold: {copies} vertices were duplicated, and joined again "
        f"over gaps of at most {percent['gap']}": copies,
        f"{one_sided} vertices lie on one-sided surfaces: both sides were deformed, and the result is their "
        f"mean, at most {percent['side_gap']} from either side": one_sided,
        f"{bent} components were deformed separately and divide the proxy vertices": bent > 1,
        f"{counted(rigid, 'component moves', 'components move')} rigidly with the handles, without a "
        "proxy": rigid,
        f"{counted(unconstrained, 'component without handles follows', 'components without handles follow')} "
        "the nearest component rigidly": unconstrained,
        f"components that touched came apart by {percent['opening']}": facts.get("opening", 0) > APART,
    }
    return [note for note, holds in found.items() if holds]


def unused_options(options: argparse.Namespace, path: Path, given: HandleFile) -> list[str]:
    """Return a note if the options that the editor saved in a handle file differ from the options used."""
    differ = [name for name, value in given.made.items() if getattr(options, name, value) != value]
    if not differ or options.options is not None:
        return []
    return [f"{path} was saved with other values of {', '.join(differ)}; pass --options {path} to use them"]


def _on_samples(facts: Mapping[str, Any], *, components: int) -> dict[str, bool]:
    """Sentences on a number of samples that differs from the number ``asked`` by more than rounding."""
    from sshade.proxy.sample import SPARE  # imports large libraries

    samples, asked, coarser = facts["samples"], facts["asked"], facts["options"]["coarser"]
    differs = f"the proxy has {samples} samples instead of {asked}: "
    each = f"{coarser} vertices" if coarser > 1 else "vertex"
    of = "a component" + (", where both sides of a surface count" if facts.get("one_sided") else "")
    return {
        "no proxy was made: the handles alone determine the result": samples == 0,
        f"{differs}at most one for every {each} of {of}, or one for each handle and {SPARE} more": 0
        < samples
        < asked - components / 2,
        f"{differs}each component has one for each handle and {SPARE} more": samples > asked + components / 2,
    }

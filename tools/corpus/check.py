"""Check a deformed mesh against its rest shape and its handles, without any code of the package."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from tools.corpus.document import Document
from tools.corpus.handles import Made
from tools.corpus.joints import Joints

#: Distance of a hard handle from its target, as a fraction of the diagonal.
EXACT = 1e-6
#: Distance that needs a warning; the messages must state smaller distances, too.
COARSE = 1e-4
#: An edge may become this many times as long as the motions of the handles imply. In the corpus, the largest
#: value without a tear is 1.43 for handle regions, and 2.1 for a few handles, which pull at single edges. The
#: smallest value with a tear is 1.8.
STRETCH, STRETCH_OF_FEW = 1.6, 2.2
#: Edges count as at least this fraction of the median edge: proxies do not resolve shorter edges.
SHORT = 0.3
#: A vertex may move farther than the handles by this fraction of the diagonal.
NEAR = 1e-3
#: Largest motion of a vertex over the largest motion of a handle.
FLIGHT = 4.0


def faults(
    rest: Document,
    result: Document,
    joints: Joints,
    handles: Made,
    messages: Sequence[str],
    *,
    same_format: bool = True,
    within: float = EXACT,
    stretch: float = STRETCH,
) -> list[str]:
    """Return what is wrong with a result, a sentence each."""
    if result.V.shape != rest.V.shape:
        return [f"{len(rest.V)} vertices became {len(result.V)}"]
    if not np.array_equal(rest.F, result.F):
        return ["faces or their order changed"]
    if not np.isfinite(result.V).all():
        return ["a position is not finite"]
    found = ["contents other than positions changed"] if same_format and rest.rest != result.rest else []
    found += _missed(handles, result, joints.diagonal, messages, within)
    found += _torn(joints, rest, result)
    found += _stretched(joints, handles, rest, result, stretch)
    found += _elsewhere(joints, handles, rest, result)
    return found


def stated(messages: Sequence[str], *, start: str = "") -> list[float]:
    """Return the fractions of the diagonal that the messages state."""
    text = "\n".join(line for line in messages if line.startswith(start))
    return [float(number) / 100 for number in re.findall(r"(\d[\d.e+-]*) %\s+of\s+the\s+diagonal", text)]


def _missed(
    handles: Made, result: Document, diagonal: float, messages: Sequence[str], within: float
) -> list[str]:
    """Hard handles are on their targets, or messages give the distance: warnings, or rounding costs."""
    gap = np.linalg.norm(result.V[handles.index] - handles.target, axis=1) / diagonal
    worst, rounding = float(gap.max()), 2 * result.step / diagonal
    warned = max(stated(messages, start="warning: "), default=0.0)
    told = max(stated(messages), default=0.0)
    if worst > max(COARSE, within) + rounding and not worst / 2 < warned < 2 * worst:
        text = f"a handle is {100 * worst:.2g} % of the diagonal from its target"
        return [
            f"{text}, and the warning says {100 * warned:.2g} %" if warned else f"{text}, without a warning"
        ]
    silent = worst > within + min(rounding, COARSE) and told < worst / 2
    if silent or (handles.complete and gap.mean() > 1.5 * told + rounding + 1e-9):
        return [f"handles are up to {100 * worst:.2g} % of the diagonal off, which no message says"]
    return []


def _torn(joints: Joints, rest: Document, result: Document) -> list[str]:
    """Sides of a shared edge stay together: each has another side within the noise."""
    noise = 4 * joints.tolerance + 4 * result.step
    worst, at = 0.0, -1
    for sides in joints.shared():
        P, k = result.V[sides], sides.shape[1]
        gap = np.linalg.norm(P[:, :, None] - P[:, None], axis=-1).max(axis=-1)
        gap[:, range(k), range(k)] = np.inf
        apart = gap.min(axis=2)
        if apart.max() > max(worst, noise):
            worst, at = float(apart.max()), int(sides[..., 0].flat[apart.argmax()])
    if at < 0:
        return []
    return [f"torn: copies of vertex {at} are {100 * worst / joints.diagonal:.2g} % of the diagonal apart"]


def _stretched(joints: Joints, handles: Made, rest: Document, result: Document, stretch: float) -> list[str]:
    """No edge is much longer than the motions of the handles imply."""
    edges = joints.edges()
    before, after = (np.linalg.norm(V[edges[:, 1]] - V[edges[:, 0]], axis=1) for V in (rest.V, result.V))
    slope = handles.slope[joints.component[edges[:, 0]]]
    allowed = stretch * (1 + slope) * np.maximum(before, SHORT * np.median(before)) + 4 * result.step
    torn = after > allowed
    if not torn.any():
        return []
    i = (after / allowed).argmax()
    return [
        f"{torn.sum()} edges are torn: edge {edges[i].tolist()} grew from {before[i]:.3g} to {after[i]:.3g}"
    ]


def _elsewhere(joints: Joints, handles: Made, rest: Document, result: Document) -> list[str]:
    """Nothing flies away, and vertices without a face stay."""
    moved = np.linalg.norm(result.V - rest.V, axis=1)
    free = joints.component < 0
    found = []
    if moved[free].max(initial=0.0) > result.step:
        found.append("a vertex without a face moved")
    longest = np.linalg.norm(handles.target - rest.V[handles.index], axis=1).max()
    if handles.complete and moved.max() > FLIGHT * longest + NEAR * joints.diagonal + 4 * result.step:
        found.append(f"vertex {moved.argmax()} moved by {moved.max():.3g}, handles only by {longest:.3g}")
    return found

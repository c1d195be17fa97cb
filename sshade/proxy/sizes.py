"""Numbers of proxy vertices: what a mesh, its handles and its components allow."""

from __future__ import annotations

import numpy as np

from sshade.problem.options import Options

#: Smallest number of proxy vertices besides the handles.
SPARE = 4
#: Number of handles that always find room on a proxy; more handles are thinned.
HANDLES = 1500


def least_vertices(handles: int) -> int:
    """Return the smallest number of proxy vertices for a number of handles."""
    return min(handles, HANDLES) + SPARE


def proxy_vertices(asked: int, n: int, handles: int = 0, *, coarser: int = Options.coarser) -> int:
    """Return how many vertices a proxy samples: `asked`, but of a small mesh at most ``n // coarser``.

    A proxy with more than a quarter of the vertices has no detail to leave out. Handles find room whatever
    the mesh's size: see :func:`least_vertices`.

    Parameters
    ----------
    asked : int
        Fewer vertices than handles are returned unchanged; the sampling thins the handles or refuses.
    n : int
        Vertices of the mesh.
    handles : int
        Handle vertices.
    coarser : int
        Smallest ratio of the mesh's vertices to the proxy's.
    """
    return min(asked, n, max(n // coarser, least_vertices(handles)))


def shared_vertices(asked: int, area: np.ndarray, least: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Distribute proxy vertices over components by area, within the numbers that the components can use.

    Parameters
    ----------
    asked : int
        Wanted total.
    area : (c,) float64
        Of each component.
    least, most : (c,) int
        Smallest and largest number of each component. A component takes no more than its largest number; the
        rest goes to the other components.

    Returns
    -------
    (c,) int64
        Their sum is `asked` up to rounding, unless all components have their smallest or largest numbers.
    """
    share, free = np.array(least, dtype=np.float64), np.ones(len(area), dtype=bool)
    while (total := area[free].sum()) > 0:
        share[free] = (asked - share[~free].sum()) / total * area[free]
        low, high = free & (share < least), free & (share > most)
        # With more to give back than to add, the components at their largest numbers stay there.
        fixed = high if (share - most)[high].sum() >= (least - share)[low].sum() else low
        if not fixed.any():
            break
        share[fixed] = np.clip(share, least, most)[fixed]
        free &= ~fixed
    # Components without area have their smallest number.
    return np.round(np.clip(share, least, most)).astype(np.int64)

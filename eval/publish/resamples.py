"""Quantiles of the mean over resamples that draw the lines and, independently, the columns of a table.

Nothing is drawn at random, so no quantile depends on a seed. All ways to draw the columns are enumerated.
Given one of them, the mean is a sum of independent draws of lines, whose characteristic function is a power
of that of one draw. The Fourier series of the density of the mean follows, and its quantiles. Only tables of
many lines and columns have too many ways to draw the columns; for them, some ways are drawn.
"""

from __future__ import annotations

from functools import cache
from itertools import chain, combinations
from math import comb, factorial

import numpy as np

from sshade.core.kernels import kernel

#: Largest number of ways to draw columns that are enumerated; for more: number of drawn ways, and the seed.
WAYS, DRAWN, SEED = 100_000, 20_000, 0
#: Number of frequencies, which resolves the range of the mean into as many parts.
FREQUENCIES = 2048
#: The frequencies end where the series stays below this fraction of the probability of a quantile.
NEGLIGIBLE = 0.01
#: Weight of the last frequency. Gaussian weights keep the density from oscillating at jumps.
LAST = 1e-12
#: Margin on both sides of the range, as a fraction of the range.
MARGIN = 0.01


@cache
def ways(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return how often each of n things is drawn in n draws (w, n), and the probability of each way (w,)."""
    number = comb(2 * n - 1, n)
    if number > WAYS:
        drawn = np.random.default_rng(SEED).multinomial(n, np.full(n, 1 / n), size=DRAWN)
        return drawn.astype(float), np.full(DRAWN, 1 / DRAWN)
    # Each way is an arrangement of n draws and n - 1 bars between things.
    bars = np.fromiter(chain.from_iterable(combinations(range(2 * n - 1), n - 1)), int)
    bars = bars.reshape(number, n - 1)
    counts = np.diff(bars, prepend=-1, append=2 * n - 1) - 1
    factorials = np.array([factorial(count) for count in range(n + 1)], dtype=float)
    return counts.astype(float), factorials[n] / factorials[counts].prod(axis=1) / float(n) ** n


def quantiles(table: np.ndarray, tail: float) -> tuple[float, float]:
    """Return the lower and upper quantile of the mean over resamples of the lines and columns of a table.

    Parameters
    ----------
    table : (n, m) float64
        Resamples have n lines and m columns, too.
    tail : float
        Probability below the lower and above the upper quantile. Three standard errors make it smaller where
        the ways are drawn.
    """
    least, most = table.min(), table.max()
    if least == most:
        return least, most
    counts, chances = ways(table.shape[1])
    if comb(2 * table.shape[1] - 1, table.shape[1]) > WAYS:
        tail = max(tail - 3 * np.sqrt(tail / DRAWN), 1 / DRAWN)
    start = least - MARGIN * (most - least)
    length = (1 + 2 * MARGIN) * (most - least)
    angles = 2 * np.pi * (table - start) / (length * table.size)
    series = _series(angles, counts, chances, FREQUENCIES, NEGLIGIBLE * tail)
    series *= LAST ** ((np.arange(FREQUENCIES + 1) / FREQUENCIES) ** 2)
    bins = 2 * FREQUENCIES
    below = np.cumsum(np.fft.irfft(series.conj(), bins))
    ends = start + length * (np.arange(bins) + 0.5) / bins
    low, high = (_crossing(below, ends, share) for share in (tail, 1 - tail))
    return max(low, least), min(high, most)


def _crossing(below: np.ndarray, ends: np.ndarray, share: float) -> float:
    """Return where a cumulative distribution first reaches a share."""
    i = int(np.argmax(below >= share))
    return float(np.interp(share, below[i - 1 : i + 1], ends[i - 1 : i + 1]))


@kernel
def _series(
    angles: np.ndarray, counts: np.ndarray, chances: np.ndarray, last: int, negligible: float
) -> np.ndarray:
    """Return the means of exp(i k X) for k = 0 to `last`, zero from eight on that are negligible.

    X is the sum of the angles (n, m) of n drawn lines in the columns of a way (w, m), with its chance (w,).
    """
    n, m = angles.shape
    one = np.empty((len(counts), n), dtype=np.complex128)
    for way in range(len(counts)):
        for line in range(n):
            angle = 0.0
            for column in range(m):
                angle += counts[way, column] * angles[line, column]
            one[way, line] = complex(np.cos(angle), np.sin(angle))
    power = np.ones_like(one)
    series = np.zeros(last + 1, dtype=np.complex128)
    series[0] = 1.0
    for first in range(1, last + 1, 8):
        end = min(first + 8, last + 1)
        for way in range(len(counts)):
            for k in range(first, end):
                draw = 0j
                for line in range(n):
                    power[way, line] *= one[way, line]
                    draw += power[way, line]
                draw /= n
                mean = chances[way] + 0j
                exponent = n
                while exponent:
                    if exponent % 2:
                        mean *= draw
                    draw *= draw
                    exponent //= 2
                series[k] += mean
        if np.abs(series[first:end]).max() < negligible:
            break
    return series

"""Intervals of paired differences over subjects, and ranks that respect them.

Runs of one subject resemble each other, so a subject counts once: the runs of a subject are averaged first.
docs/measures.md explains the choice of the intervals and measures how often they cover the true mean.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pandas as pd
from scipy import special

#: Probability that an interval covers the mean of all subjects, if differences are normal.
LEVEL = 0.95
#: Smallest number of subjects for intervals and ranks, and for intervals from a bootstrap.
LEAST, BOOTSTRAP = 3, 8
#: Number and seed of the resamples of a bootstrap.
RESAMPLES, SEED = 9999, 0
#: Methods to which differences are shown, in the order of preference; otherwise the first method.
REFERENCE = ("elastic", "accelerated_elastic")


def interval(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper ends of the intervals of means.

    Three to seven subjects have the interval of Student's t. More subjects have the percentile interval of a
    bootstrap, expanded to the width that small samples need (Hesterberg 2015, section 4.3).

    Parameters
    ----------
    values : (n, k) float64
        One row per subject.

    Returns
    -------
    low, high : (k,) float64
        NaN for fewer than three subjects.
    """
    n = len(values)
    if n < LEAST:
        return np.full(values.shape[1], np.nan), np.full(values.shape[1], np.nan)
    quantile = special.stdtrit(n - 1, (1 + LEVEL) / 2)
    if n < BOOTSTRAP:
        middle, half = values.mean(axis=0), quantile * values.std(axis=0, ddof=1) / np.sqrt(n)
        return middle - half, middle + half
    tail = special.ndtr(-quantile * np.sqrt(n / (n - 1)))
    low, high = np.quantile(values.T @ _resampling(n), [tail, 1 - tail], axis=1)
    return low, high


@cache
def _resampling(n: int) -> np.ndarray:
    """Return the portion of each subject (line) in each resample (column)."""
    drawn = np.random.default_rng(SEED).integers(n, size=(RESAMPLES, n))
    return np.stack([(drawn == subject).mean(axis=1) for subject in range(n)])


def kind_of_interval(subjects: int) -> str:
    """Return the name of the intervals over a number of subjects."""
    return "Student's t" if subjects < BOOTSTRAP else "bootstrap"


def reference_of(methods: list[str]) -> str:
    """Return the method to which differences are shown."""
    return next((name for name in REFERENCE if name in methods), methods[0])


def differences(of_subjects: pd.DataFrame, reference: str) -> pd.DataFrame:
    """Return the mean difference of each method to a reference, and the ends of its interval.

    Parameters
    ----------
    of_subjects : DataFrame
        A number for each subject (line) and method (column).
    reference : str

    Returns
    -------
    DataFrame
        By method: ``difference``, ``low``, ``high``.
    """
    paired = of_subjects.sub(of_subjects[reference], axis=0)
    low, high = interval(paired.to_numpy(dtype=float))
    return pd.DataFrame({"difference": paired.mean(skipna=False), "low": low, "high": high})


def places(of_subjects: pd.DataFrame, means: pd.Series, printed: pd.Series) -> pd.Series:
    """Return the rank of each method; empty for fewer than three subjects.

    The leader is the method with the lowest mean. A method shares the rank of the leader if the interval of
    its difference to the leader does not lie above zero, or if both means are printed alike. The other
    methods are ranked in the same way among themselves, and rank behind all methods that were ranked before.

    Parameters
    ----------
    of_subjects : DataFrame
        A number for each subject (line) and method (column).
    means, printed : Series
        Mean of each method, exact and as printed.
    """
    rank: dict[str, int] = {}
    left = list(means.sort_values(kind="stable").index) if len(of_subjects) >= LEAST else []
    while left:
        low = differences(of_subjects[left], left[0])["low"]
        equal = [name for name in left if low[name] <= 0 or printed[name] == printed[left[0]]]
        rank |= dict.fromkeys(equal, len(rank) + 1)
        left = [name for name in left if name not in equal]
    return pd.Series(rank, dtype=float)

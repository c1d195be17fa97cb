"""Intervals of paired differences over subjects and poses, and ranks that respect them.

Cases of one subject resemble each other, and so do cases in one pose. A resample therefore draws subjects
and, independently of them, poses, both with replacement. A case counts as often as its subject was drawn,
times how often its pose was drawn (Owen 2007, the pigeonhole bootstrap). docs/measures.md has the formula.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from scipy import special

#: Probability that an interval covers the true mean.
LEVEL = 0.95
#: Smallest numbers of subjects, poses or cases for intervals and ranks. Fewer give too narrow intervals.
LEAST = {"subjects": 3, "poses": 3, "cases": 5}
#: Number and seed of the resamples.
RESAMPLES, SEED = 39_999, 0
#: Methods to which differences are shown, in the order of preference; otherwise the first method.
REFERENCE = ("elastic", "accelerated_elastic")


@dataclass(frozen=True, eq=False)
class Resampling:
    """The resamples of some cases.

    Parameters
    ----------
    drawn : dict
        Name, such as "subjects" -> the number of the subject of each case (n,), from 0.
    reason : str
        Why cases are drawn; empty otherwise.
    """

    drawn: Mapping[str, np.ndarray]
    reason: str = ""

    @classmethod
    def of(cls, subjects: Sequence[str], poses: Sequence[str]) -> Resampling:
        """Draw subjects and poses; draw cases if there is one subject, or each subject has one pose."""
        subject, pose = (pd.factorize(np.array(names), sort=True)[0] for names in (subjects, poses))
        several = pd.Series(pose).groupby(subject).nunique()
        if len(several) > 1 and several.max() > 1:
            return cls({"subjects": subject, "poses": pose})
        why = "each subject has one pose" if len(several) > 1 else "there is one subject"
        return cls({"cases": np.arange(len(subject))}, why)

    @property
    def counts(self) -> dict[str, int]:
        """How many subjects and poses, or cases, there are to draw."""
        return {name: int(own.max(initial=-1)) + 1 for name, own in self.drawn.items()}

    @property
    def enough(self) -> bool:
        """Whether there are enough subjects and poses, or cases, for intervals and ranks."""
        return all(n >= LEAST[name] for name, n in self.counts.items())

    def __str__(self) -> str:
        text = " and ".join(f"{n} {name if n != 1 else name[:-1]}" for name, n in self.counts.items())
        return f"{text} ({self.reason})" if self.reason else text

    @cached_property
    def weights(self) -> np.ndarray:
        """The share of each case (line) in each resample (column) that has a case."""
        random = np.random.default_rng(SEED)
        times = np.ones(1)
        for name, n in self.counts.items():
            drawn = random.multinomial(n, np.full(n, 1 / n), size=RESAMPLES).T
            times = times * drawn[self.drawn[name]]
        weights = times[:, times.any(axis=0)]
        return weights / weights.sum(axis=0)


def interval(values: np.ndarray, resampling: Resampling) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper ends of the intervals of means.

    They are percentiles of the means of the resamples, expanded to the width that small samples need
    (Hesterberg 2015, section 4.3). n is the smaller number of subjects and of poses, and t is Student's
    quantile with n - 1 degrees of freedom. The tails are the normal distribution's at t sqrt(n / (n - 1)).

    Parameters
    ----------
    values : (n, k) float64
        One row per case.
    resampling : Resampling
        Of these cases.

    Returns
    -------
    low, high : (k,) float64
        NaN for fewer subjects or poses than :data:`LEAST`.
    """
    if not resampling.enough:
        return np.full(values.shape[1], np.nan), np.full(values.shape[1], np.nan)
    n = min(resampling.counts.values())
    quantile = special.stdtrit(n - 1, (1 + LEVEL) / 2)
    tail = special.ndtr(-quantile * np.sqrt(n / (n - 1)))
    low, high = np.quantile(values.T @ resampling.weights, [tail, 1 - tail], axis=1)
    return low, high


def reference_of(methods: list[str]) -> str:
    """Return the method to which differences are shown."""
    return next((name for name in REFERENCE if name in methods), methods[0])


def differences(of_cases: pd.DataFrame, reference: str, resampling: Resampling) -> pd.DataFrame:
    """Return the mean difference of each method to a reference, the ends of its interval, and a count.

    Parameters
    ----------
    of_cases : DataFrame
        A number for each case (line) and method (column).
    reference : str
    resampling : Resampling
        Of these cases.

    Returns
    -------
    DataFrame
        By method: ``difference``, ``low``, ``high``, and ``smaller``, the number of cases in which the method
        has a smaller number than the reference.
    """
    paired = of_cases.sub(of_cases[reference], axis=0)
    low, high = interval(paired.to_numpy(dtype=float), resampling)
    found = {"difference": paired.mean(skipna=False), "low": low, "high": high, "smaller": (paired < 0).sum()}
    return pd.DataFrame(found)


def places(of_cases: pd.DataFrame, means: pd.Series, printed: pd.Series, resampling: Resampling) -> pd.Series:
    """Return the rank of each method; empty for fewer subjects or poses than :data:`LEAST`.

    The leader is the method with the lowest mean. A method shares the rank of the leader if the interval of
    its difference to the leader does not lie above zero, or if both means are printed alike. The other
    methods are ranked in the same way among themselves, and rank behind all methods that were ranked before.

    Parameters
    ----------
    of_cases : DataFrame
        A number for each case (line) and method (column).
    means, printed : Series
        Mean of each method, exact and as printed.
    resampling : Resampling
        Of these cases.
    """
    rank: dict[str, int] = {}
    left = list(means.sort_values(kind="stable").index) if resampling.enough else []
    while left:
        low = differences(of_cases[left], left[0], resampling)["low"]
        equal = [name for name in left if low[name] <= 0 or printed[name] == printed[left[0]]]
        rank |= dict.fromkeys(equal, len(rank) + 1)
        left = [name for name in left if name not in equal]
    return pd.Series(rank, dtype=float)

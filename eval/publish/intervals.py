"""Intervals of paired differences over subjects and poses, and ranks that respect them.

Cases of one subject resemble each other, and so do cases in one pose. A resample therefore draws subjects
and, independently of them, poses, both with replacement. A case counts as often as its subject was drawn,
times how often its pose was drawn (Owen 2007, the pigeonhole bootstrap). docs/measures.md has the formula,
and :mod:`eval.publish.resamples` weighs all resamples.

Ends of intervals are compared with zero as they are printed, so that neither last bits nor resolution decide.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import pandas as pd
from scipy import special

from eval.publish.columns import Column
from eval.publish.resamples import quantiles

T = TypeVar("T", pd.DataFrame, pd.Series)

#: Probability that an interval covers the true mean.
LEVEL = 0.95
#: Smallest numbers of subjects, poses or cases for intervals and ranks. Fewer give too narrow intervals.
LEAST = {"subjects": 3, "poses": 3, "cases": 5}
#: Decimal digits of a measure below its largest value that count. Other digits depend on the processor.
DIGITS = 9
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

    def table(self, values: np.ndarray) -> np.ndarray:
        """Return a table of the values (n,) of cases, for :func:`eval.publish.resamples.quantiles`.

        The poses are columns if they are fewer. A missing case counts as the mean, and the deviations of the
        others grow, because each of them is a larger share of the mean. This linearises the mean over the
        cases of a resample.
        """
        names = sorted(self.drawn, key=self.counts.__getitem__, reverse=True)
        places = [self.drawn[name] for name in names]
        sums = np.zeros([self.counts[name] for name in names])
        mean = values.mean()
        np.add.at(sums, tuple(places), values - mean)
        return (mean + sums * (sums.size / len(values))).reshape(len(sums), -1)


def interval(values: np.ndarray, resampling: Resampling) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper ends of the intervals of means.

    They are quantiles of the means of all resamples, expanded to the width that small samples need
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
        NaN where a value is NaN, and for fewer subjects or poses than :data:`LEAST`.
    """
    ends = np.full((2, values.shape[1]), np.nan)
    if resampling.enough:
        n = min(resampling.counts.values())
        quantile = special.stdtrit(n - 1, (1 + LEVEL) / 2)
        tail = special.ndtr(-quantile * np.sqrt(n / (n - 1)))
        for k in np.flatnonzero(np.isfinite(values).all(axis=0)):
            own = values[:, k]
            ends[:, k] = np.clip(quantiles(resampling.table(own), tail), own.min(), own.max())
    return ends[0], ends[1]


def reference_of(methods: list[str]) -> str:
    """Return the method to which differences are shown."""
    return next((name for name in REFERENCE if name in methods), methods[0])


def differences(
    of_cases: pd.DataFrame, reference: str, resampling: Resampling, *, decimals: int
) -> pd.DataFrame:
    """Return the mean difference of each method to a reference, the ends of its interval, and a count.

    Parameters
    ----------
    of_cases : DataFrame
        A number for each case (line) and method (column).
    reference : str
    resampling : Resampling
        Of these cases.
    decimals : int
        Number of printed decimals. Ends of intervals have no more.

    Returns
    -------
    DataFrame
        By method: ``difference``, ``low``, ``high``, and ``smaller``, the number of cases in which the method
        has a smaller number than the reference.
    """
    paired = rounded(of_cases.sub(of_cases[reference], axis=0), of_cases)
    low, high = (np.round(end, decimals) + 0.0 for end in interval(paired.to_numpy(dtype=float), resampling))
    found = {"difference": paired.mean(skipna=False), "low": low, "high": high, "smaller": (paired < 0).sum()}
    return pd.DataFrame(found)


def rounded(values: T, of_cases: pd.DataFrame) -> T:
    """Round to :data:`DIGITS` digits below the largest number of cases; -0.0 becomes 0.0."""
    largest = np.nanmax(np.abs(of_cases.to_numpy(dtype=float)), initial=0.0)
    return values if largest == 0 else values.round(DIGITS - int(np.ceil(np.log10(largest)))) + 0.0


def places(of_cases: pd.DataFrame, resampling: Resampling, column: Column) -> pd.Series:
    """Return the rank of each method; empty for fewer subjects or poses than :data:`LEAST`.

    The leader is the method with the lowest mean. A method shares the rank of the leader if the interval of
    its difference to the leader does not lie above zero, or if both means are printed alike. The other
    methods are ranked in the same way among themselves, and rank behind all methods that were ranked before.
    A method that lacks the number in a case has no rank.

    Parameters
    ----------
    of_cases : DataFrame
        A number for each case (line) and method (column).
    resampling : Resampling
        Of these cases.
    column : Column
        The column of the numbers.
    """
    means = rounded(of_cases.mean(skipna=False).dropna(), of_cases)
    rank: dict[str, int] = {}
    left = list(means.sort_values(kind="stable").index) if resampling.enough else []
    while left:
        leader, best = of_cases[left[0]], column.text(means[left[0]])
        # An interval begins above the smallest difference, so a method that loses every case needs none.
        near = [name for name in left if (of_cases[name] - leader).min() < 10.0**-column.decimals]
        low = differences(of_cases[near], left[0], resampling, decimals=column.decimals)["low"]
        equal = [name for name in near if low[name] <= 0 or column.text(means[name]) == best]
        rank |= dict.fromkeys(equal, len(rank) + 1)
        left = [name for name in left if name not in equal]
    return pd.Series(rank, dtype=float)

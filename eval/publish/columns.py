"""What the columns of a table are, of deformations and of pose transfers; what no table ranks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pandas as pd

from eval.rows.frame import distinct, numbers
from eval.rows.store import TRANSFER

#: Functions that are no methods, whatever their label, and what tables say of them.
REFERENCES = {
    "baselines.identity.identity": "no method but what doing nothing costs: the rest shape with its handles "
    "on their targets. It takes part in no ranking."
}


@dataclass(frozen=True)
class Column:
    """One number of a table.

    Parameters
    ----------
    heading, unit : str
    source : str
        The row's column.
    decimals : int
        What it is printed with.
    ranked : bool
        Whether the lowest ones are marked.
    optional : bool
        Left out of tables whose rows have nothing there, or only zeros.
    legend : str
        What it says, where it is no metric.
    scientific : bool
        Printed with a power of ten.
    """

    heading: str
    unit: str
    source: str
    decimals: int
    ranked: bool = True
    optional: bool = False
    legend: str = ""
    scientific: bool = False

    @property
    def label(self) -> str:
        """The heading with its unit."""
        return f"{self.heading} ({self.unit})" if self.unit else self.heading

    def text(self, mean: float) -> str:
        """The number as printed; times keep three digits, from milliseconds to hours."""
        if self.scientific:
            return f"{mean:.{self.decimals}e}"
        decimals = self.decimals
        if self.unit == "s":
            decimals = next((d for bound, d in ((100, 0), (10, 1), (1, 2)) if mean >= bound), 3)
        return f"{mean:.{decimals}f}"


COLUMNS = (
    Column("volume", "%", "metric.volume", 2),
    Column("area", "%", "metric.area", 2),
    Column("EL", "%", "metric.edge", 2),
    Column("FA", "deg", "metric.angle", 3),
    Column("handle", "%", "metric.handle", 3),
    Column("flips", "", "metric.flips", 1, optional=True),
    Column("crossings", "", "metric.self_intersections", 1, optional=True),
    Column(
        "far",
        "%",
        "extra.far_share",
        3,
        optional=True,
        legend="vertices carried by a proxy triangle more than 2 covering radii away along the proxy",
    ),
    Column("iterations", "", "iterations", 0, ranked=False),
    Column("time", "s", "seconds.total", 2),
)

#: Of pose transfers with a known truth.
TRANSFER_COLUMNS = (
    Column("d_H", "", "metric.hausdorff", 2, scientific=True),
    Column("d_C", "", "metric.chamfer", 2, scientific=True),
    Column("distance", "%", "metric.truth_distance", 4),
    Column("EL to truth", "%", "metric.truth_edge", 3),
    Column("FA to truth", "deg", "metric.truth_angle", 3),
    Column("time", "s", "seconds.total", 2),
)


def columns_of(rows: pd.DataFrame) -> tuple[Column, ...]:
    """The columns of deformations by handles, or of pose transfers."""
    if not are_transfers(rows):
        return COLUMNS
    if numbers(rows, "metric.hausdorff").notna().any():
        return TRANSFER_COLUMNS
    # Without a truth there is what changed against the rest shape, some of which is the pose's own doing.
    return tuple(
        replace(c, ranked=c.unit == "s") for c in COLUMNS if c.source not in ("metric.handle", "iterations")
    )


def are_transfers(rows: pd.DataFrame) -> bool:
    """Whether rows are of pose transfers."""
    return TRANSFER in distinct(rows, "task.kind")


def reference_rows(rows: pd.DataFrame) -> pd.Series:
    """Whether each row is one of a reference, such as doing nothing, which no table ranks."""
    return rows.reindex(columns=["method.target"])["method.target"].isin(REFERENCES)

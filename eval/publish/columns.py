"""What the columns of a table are, of deformations and of pose transfers; what no table ranks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pandas as pd

from eval.rows.frame import distinct, numbers
from eval.rows.store import MISSING, TRANSFER, VALID

#: Functions that are no methods, whatever their label, and what tables say of them.
REFERENCES = {
    "baselines.identity.identity": "no method but what doing nothing costs: the rest shape with its handles "
    "on their targets. It takes part in no ranking."
}


#: Mean distance of handles to their targets, in percent of the diagonal, up to which a result reaches them.
REACHED = 0.1

#: The column of :func:`with_success`, which no run has.
SUCCESS = "success"


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
    hidden : bool
        Stands in the second table, of what means hide; left out where no row has a value.
    """

    heading: str
    unit: str
    source: str
    decimals: int
    ranked: bool = True
    optional: bool = False
    legend: str = ""
    scientific: bool = False
    hidden: bool = False

    @property
    def label(self) -> str:
        """The heading with its unit."""
        return f"{self.heading} ({self.unit})" if self.unit else self.heading

    def text(self, value: float) -> str:
        """The number as printed."""
        return f"{value:.{self.decimals}{'e' if self.scientific else 'f'}}"


COLUMNS = (
    Column("volume", "%", "metric.volume", 2),
    Column("area", "%", "metric.area", 2),
    Column("EL", "%", "metric.edge", 2),
    Column("FA", "deg", "metric.angle", 3),
    Column("handle", "%", "metric.handle", 3),
    Column("flips", "", "metric.flips", 1, optional=True),
    # Not ranked: where handles bring parts together, the true pose crosses itself, too.
    Column("crossings", "", "metric.self_intersections", 1, ranked=False, optional=True),
    Column(
        "far",
        "%",
        "extra.far_share",
        3,
        optional=True,
        legend="vertices carried by a proxy triangle more than 2 covering radii away along the proxy",
    ),
    Column("iterations", "", "iterations", 0, ranked=False),
    Column("truth", "%", "metric.truth_distance", 2, hidden=True),
    Column("truth 95", "%", "metric.truth_distance_95", 2, hidden=True),
    Column("normal", "deg", "metric.truth_normal", 2, hidden=True),
    Column("D", "", "metric.distortion", 4, hidden=True),
    Column("D 95", "", "metric.distortion_95", 3, hidden=True),
    Column("D 99", "", "metric.distortion_99", 3, hidden=True),
    Column("D max", "", "metric.distortion_max", 1, hidden=True),
    Column("collapsed", "", "metric.collapsed", 1, hidden=True),
    Column("bend", "deg", "metric.bend", 2, hidden=True),
    Column("bend 99.9", "deg", "metric.bend_tail", 1, hidden=True),
    Column("detail", "deg", "metric.detail", 2, hidden=True),
    Column("spike", "deg", "metric.spike", 1, hidden=True),
    Column(
        "success",
        "%",
        SUCCESS,
        1,
        ranked=False,
        hidden=True,
        legend=f"planned runs with a result whose handles are on average within {REACHED:g} % of the "
        "diagonal of their targets",
    ),
)

#: Of pose transfers with a known truth.
TRANSFER_COLUMNS = (
    Column("d_H", "", "metric.hausdorff", 2, scientific=True),
    Column("d_C", "", "metric.chamfer", 2, scientific=True),
    Column("distance", "%", "metric.truth_distance", 4),
    Column("EL to truth", "%", "metric.truth_edge", 3),
    Column("FA to truth", "deg", "metric.truth_angle", 3),
    Column("distance 95", "%", "metric.truth_distance_95", 4, hidden=True),
    Column("normal", "deg", "metric.truth_normal", 3, hidden=True),
)


def columns_of(rows: pd.DataFrame) -> tuple[Column, ...]:
    """The columns of deformations by handles, or of pose transfers, that the rows have numbers for."""
    columns = COLUMNS
    if are_transfers(rows):
        columns = TRANSFER_COLUMNS
        if numbers(rows, "metric.hausdorff").isna().all():
            # Without a truth there is what changed against the rest shape, some of it the pose's own doing.
            columns = tuple(
                replace(column, ranked=False)
                for column in COLUMNS
                if not column.hidden and column.source not in ("metric.handle", "iterations")
            )
    return tuple(column for column in columns if _is_shown(column, numbers(rows, column.source)))


def _is_shown(column: Column, values: pd.Series) -> bool:
    if column.hidden:
        return values.notna().any()
    return not column.optional or values.fillna(0).any()


def begun(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows of runs that took place; the others tell only that one was planned."""
    return rows[rows["status"] != MISSING]


def with_success(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows with a column :data:`SUCCESS`: 100 where the run has a result that reaches its handles, else 0."""
    reached = rows["status"].isin(VALID) & (numbers(rows, "metric.handle") <= REACHED)
    return rows.assign(**{SUCCESS: 100.0 * reached})


def are_transfers(rows: pd.DataFrame) -> bool:
    """Whether rows are of pose transfers."""
    return TRANSFER in distinct(rows, "task.kind")


def reference_rows(rows: pd.DataFrame) -> pd.Series:
    """Whether each row is one of a reference, such as doing nothing, which no table ranks."""
    return rows.reindex(columns=["method.target"])["method.target"].isin(REFERENCES)

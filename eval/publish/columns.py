"""The columns of tables, the methods that tables do not rank, and tables in Markdown."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple

import pandas as pd

from eval.rows.frame import distinct, numbers, to_frame
from eval.rows.store import TRANSFER, VALID

#: Functions that are references rather than methods, with their notes in tables.
REFERENCES = {
    "baselines.identity.identity": "a reference, not a method: the rest shape with its handles at their "
    "targets. It is not ranked.",
    "eval.metrics.measure": "no method, but the true shapes, measured like results. They stretch and bend, "
    "too: a measure of change below theirs is no better.",
}
#: Largest mean distance of the handles to their targets for a success, % of the bounding-box diagonal.
REACHED = 0.1
#: Column of the mean distance to the true pose.
TRUTH = "metric.truth_distance"
#: Column of the time of a method.
TIME = "seconds.total"
#: Column that :func:`with_success` adds.
SUCCESS = "success"
#: Definitions of columns that are no metrics.
DEFINITIONS = {
    "extra.far_share": "vertices that follow a proxy triangle more than 2 covering radii away along the "
    "proxy",
    SUCCESS: f"runs, also missing ones, whose handles are on average within {REACHED:g} % of the diagonal of "
    "their targets",
}


class Column(NamedTuple):
    """A column of a table.

    Parameters
    ----------
    heading, unit : str
    source : str
        Column of the rows.
    decimals : int
        Number of printed decimals.
    ranked : bool
        Mark the lowest values.
    optional : bool
        Leave the column out if the rows have no value.
    scientific : bool
        Print with a power of ten.
    further : bool
        Print in the second table, if a row has a value.
    main : bool
        Show differences to the reference.
    """

    heading: str
    unit: str
    source: str
    decimals: int
    ranked: bool = True
    optional: bool = False
    scientific: bool = False
    further: bool = False
    main: bool = False

    @property
    def label(self) -> str:
        """The heading with its unit."""
        return f"{self.heading} ({self.unit})" if self.unit else self.heading

    def text(self, value: float, sign: str = "") -> str:
        """Return the printed number; `sign` "+" shows the sign of positive numbers as well."""
        return f"{value:{sign}.{self.decimals}{'e' if self.scientific else 'f'}}"


#: Status of a case of which a method has no row; only in tables.
MISSING = "missing"

COLUMNS = (
    Column("volume", "%", "metric.volume", 2, main=True),
    Column("true volume", "%", "metric.truth_volume", 2, optional=True, main=True),
    Column("area", "%", "metric.area", 2, main=True),
    Column("EL", "%", "metric.edge", 2, main=True),
    Column("FA", "deg", "metric.angle", 3, main=True),
    Column("handle", "%", "metric.handle", 3),
    Column("flips", "", "metric.flips", 1, optional=True),
    # Not ranked: the true pose intersects itself as well if handles bring parts together.
    Column("crossings", "", "metric.self_intersections", 1, ranked=False, optional=True),
    Column("far", "%", "extra.far_share", 3, optional=True),
    Column("iterations", "", "iterations", 0, ranked=False),
    Column("truth", "%", TRUTH, 2, further=True, main=True),
    Column("truth 95", "%", "metric.truth_distance_95", 2, further=True),
    Column("normal", "deg", "metric.truth_normal", 2, further=True, main=True),
    # Neither D nor D max is ranked: a single face decides both.
    Column("D", "", "metric.distortion", 4, ranked=False, further=True),
    Column("D 95", "", "metric.distortion_95", 3, further=True),
    Column("D 99", "", "metric.distortion_99", 3, further=True, main=True),
    Column("D max", "", "metric.distortion_max", 1, ranked=False, further=True),
    Column("collapsed", "", "metric.collapsed", 1, further=True),
    Column("bend", "deg", "metric.bend", 2, further=True),
    Column("bend 99.9", "deg", "metric.bend_tail", 1, further=True, main=True),
    Column("detail", "deg", "metric.detail", 2, further=True),
    Column("spike", "deg", "metric.spike", 1, further=True),
    Column("success", "%", SUCCESS, 1, ranked=False, further=True),
)

#: Columns of a table for a first look.
HEADLINE = (
    *(
        column
        for source in ("metric.volume", TRUTH, "metric.edge", "metric.self_intersections")
        for column in COLUMNS
        if column.source == source
    ),
    Column("time", "s", TIME, 2),
)

#: Columns of pose transfers with ground truth. They rank nobody, because the input has the pose.
TRANSFER_COLUMNS = (
    Column("d_H", "", "metric.hausdorff", 2, ranked=False, scientific=True),
    Column("d_C", "", "metric.chamfer", 2, ranked=False, scientific=True),
    Column("distance", "%", TRUTH, 4, ranked=False),
    Column("EL to truth", "%", "metric.truth_edge", 3, ranked=False),
    Column("FA to truth", "deg", "metric.truth_angle", 3, ranked=False),
    Column("distance 95", "%", "metric.truth_distance_95", 4, ranked=False, further=True),
    Column("normal", "deg", "metric.truth_normal", 3, ranked=False, further=True),
)


def columns_of(rows: pd.DataFrame) -> tuple[Column, ...]:
    """Return the columns for which the rows have numbers."""
    columns: tuple[Column, ...] = COLUMNS
    if are_transfers(rows):
        columns = TRANSFER_COLUMNS
        if numbers(rows, "metric.hausdorff").isna().all():
            # Without ground truth: changes from the rest shape, which include the changes of the pose itself.
            columns = tuple(
                column._replace(ranked=False)
                for column in COLUMNS
                if not column.further and column.source not in ("metric.handle", "iterations")
            )
    return tuple(column for column in columns if _is_shown(column, numbers(rows, column.source)))


def _is_shown(column: Column, values: pd.Series) -> bool:
    if column.further:
        return values.notna().any()
    return not column.optional or values.notna().any()


def with_missing(rows: pd.DataFrame) -> pd.DataFrame:
    """Add a row with status :data:`MISSING` for each method and each case of which there is no row."""
    tasks = rows.drop_duplicates("task.name").set_index("task.name").filter(like="task.")
    done = set(zip(rows["method.name"], rows["task.name"], strict=True))
    missing = [
        {"method.name": method, "task.name": task, "seed": rows["seed"].iloc[0], "status": MISSING}
        | {"reason": "never run", "task.meta.subject": tasks.get("task.meta.subject", {}).get(task)}
        for method in rows["method.name"].unique()
        for task in tasks.index
        if (method, task) not in done
    ]
    return pd.concat([rows, to_frame(missing)], ignore_index=True) if missing else rows


def begun(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of runs that have begun, without the rows that stand for missing runs."""
    return rows[rows["status"] != MISSING]


def with_success(rows: pd.DataFrame) -> pd.DataFrame:
    """Add the column :data:`SUCCESS`: 100 if the handles of the result reach their targets, else 0."""
    reached = rows["status"].isin(VALID) & (numbers(rows, "metric.handle") <= REACHED)
    rows = rows.copy()
    rows[SUCCESS] = 100.0 * reached
    return rows


def are_transfers(rows: pd.DataFrame) -> bool:
    """Whether rows are of pose transfers."""
    return TRANSFER in distinct(rows, "task.kind")


def reference_rows(rows: pd.DataFrame) -> pd.Series:
    """Whether each row is of a reference, which no table ranks."""
    return rows.reindex(columns=["method.target"])["method.target"].isin(REFERENCES)


def markdown_table(
    labels: Sequence[str], body: Iterable[Iterable[str]], *, left: Collection[str] = ()
) -> str:
    """Return a table; columns labelled in `left` are aligned left, the others right."""
    sides = ["---" if label in left else "---:" for label in labels]
    lines = (" | ".join(cell.replace("|", r"\|") for cell in cells) for cells in (labels, sides, *body))
    return "\n".join(f"| {line} |" for line in lines)

"""Blocks of docs/paper.md: the paper's numbers in ``conf/paper.yaml`` beside ours."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from eval.publish.columns import COLUMNS, markdown_table
from eval.publish.comparison import poses_of
from eval.publish.paper import NONE, beside, rows_beside
from eval.publish.summary import by_half
from eval.rows.files import read_conf
from eval.rows.frame import numbers, read_csv, valid


def numbers_of(experiment: str) -> dict[str, dict[str, float]]:
    """Return the paper's numbers for published rows, by method and measure."""
    return next(own[experiment] for own in read_conf("paper").values() if experiment in own)


def beside_the_paper(experiment: str, results: Path) -> list[list[str]]:
    """Return the paper's numbers of an experiment beside ours, as lines of cells.

    Times have a line for each timed method, also where the paper has no number.
    """
    methods, times = numbers_of(experiment), results / "tables" / f"{experiment}.csv"
    if (results / "timing" / f"{experiment}.csv").is_file():
        rows = pd.read_csv(times).rename(columns={"method": "method.name"})
        methods = {name: methods.get(name, {}) for name in rows["method.name"]}
        rows["seconds.total"] = rows["seconds.total"].astype(float)
    else:
        rows = rows_beside(results / "rows" / f"{experiment}.csv")
    head, *body = beside(methods, rows)
    return [head, [], *body]


def pose_means(path: Path, heading: str, methods: list[str], *, link: str) -> str:
    """Return the means of a column in each pose and in all of them, with the paper's numbers last.

    `path` is the CSV of the rows, whose first half has the cases, `heading` the head of the column, such as
    ``volume (%)``, and `link` the path from the page to the results.
    """
    column = next(column for column in COLUMNS if column.label == heading)
    rows = valid(next(iter(by_half(read_csv(path)).values())))
    case = [rows["task.name"].map(poses_of(rows)).rename("pose"), rows["task.name"], rows["method.name"]]
    values = numbers(rows, column.source).groupby(case).mean().unstack()[methods].dropna()
    body = [[str(pose), *map(column.text, own.mean())] for pose, own in values.groupby("pose")]
    body.append(["mean", *map(column.text, values.mean())])
    paper = [numbers_of(path.stem).get(name, {}).get(column.heading) for name in methods]
    body.append(["the paper", *(NONE if number is None else column.text(number) for number in paper)])
    table = markdown_table(["pose", *methods], body, left=["pose"])
    sizes = sorted({rows["task.vertices"].min(), rows["task.vertices"].max()})
    count = f"{len(values)} cases of {' to '.join(f'{n:,}' for n in sizes)} vertices"
    return f"[{path.stem}]({link}/rows/{path.name}): {heading}, {count}.\n\n{table}\n"

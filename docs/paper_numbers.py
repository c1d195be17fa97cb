"""Blocks of docs/paper.md and docs/times.md: the paper's numbers in ``conf/paper.yaml`` beside ours."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import pandas as pd

from eval.publish.columns import COLUMNS, markdown_table
from eval.publish.comparison import poses_of
from eval.publish.paper import NONE, beside, rows_beside
from eval.publish.summary import by_half
from eval.rows.files import read_conf
from eval.rows.frame import numbers, read_csv, valid

#: The paper's claims on time, each with the published times that answer it.
CLAIMS = {
    "seconds": ("a pose of 150,000 to 200,000 vertices takes 8 s", "paper_speed"),
    "faster": ("50 to 60 times as fast as full-resolution methods, up to 100", "paper_speed"),
    "large": ("450,000 vertices within 10 s", "paper_scaling"),
    "transfer": ("a pose transfer in about 2 s", "paper_transfer"),
    "linear": ("time grows linearly with the vertices", "paper_scaling"),
}
#: Number of vertices of the claim on large meshes.
LARGE = 450_000


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


def pose_means(path: Path, heading: str, methods: list[str], some: list[str], *, link: str) -> str:
    """Return the means of a column in each pose and in all of them, with the paper's numbers last.

    Parameters
    ----------
    path : path
        CSV of the rows. The cases are its first half.
    heading : str
        Of the column, such as ``volume (%)``.
    methods : list of str
    some : list of str
        Numbers of the poses to show; all without any. The span of the mean follows, over all choices of as
        many poses with the last of them.
    link : str
        Path from the page to the results.
    """
    column = next(column for column in COLUMNS if column.label == heading)
    rows = valid(next(iter(by_half(read_csv(path)).values())))
    case = [rows["task.name"].map(poses_of(rows)).rename("pose"), rows["task.name"], rows["method.name"]]
    values = numbers(rows, column.source).groupby(case).mean().unstack()[methods].dropna()
    number = values.index.get_level_values("pose").str.partition("_").get_level_values(0)
    shown = values[number.isin(some)] if some else values
    body = [[str(pose), *map(column.text, own.mean())] for pose, own in shown.groupby("pose")]
    body.append(["mean", *map(column.text, shown.mean())])
    if some:
        others = sorted({*number} - {some[-1]})
        sets = [{*chosen, some[-1]} for chosen in combinations(others, len(some) - 1)]
        spans = pd.DataFrame([values[number.isin(chosen)].mean() for chosen in sets])
        ends = zip(map(column.text, spans.min()), map(column.text, spans.max()), strict=True)
        name = f"mean of {len(some)} poses with {some[-1]}, in {len(sets)} choices"
        body.append([name, *(f"{low} to {high}" for low, high in ends)])
    paper = [numbers_of(path.stem).get(name, {}).get(column.heading) for name in methods]
    body.append(["the paper", *(NONE if number is None else column.text(number) for number in paper)])
    table = markdown_table(["pose", *methods], body, left=["pose"])
    sizes = sorted({rows["task.vertices"].min(), rows["task.vertices"].max()})
    count = f"{len(shown)} cases of {' to '.join(f'{n:,}' for n in sizes)} vertices"
    return f"[{path.stem}]({link}/rows/{path.name}): {heading}, {count}.\n\n{table}\n"


def time_claims(tables: Path) -> str:
    """Return a table with the paper's claims on time and our measured times; nothing without any."""
    answers = {
        "seconds": _seconds,
        "faster": _faster,
        "large": _large,
        "transfer": _transfer,
        "linear": _linear,
    }
    body = []
    for name, (claim, file) in CLAIMS.items():
        if (path := tables / f"{file}.csv").is_file():
            body.append([f"[{claim}](../results/tables/{file}.md)", answers[name](pd.read_csv(path))])
    head = ["the paper's claim", "measured here"]
    return f"{markdown_table(head, body, left=head)}\n" if body else ""


def _seconds(lines: pd.DataFrame) -> str:
    return _of_methods(lines, lambda own: f"{own['seconds.total'].iloc[0]:.2g} s")


def _faster(lines: pd.DataFrame) -> str:
    """Compare with the full-resolution methods."""
    full = lines.set_index("method")["seconds.total"][["arap", "elastic", "arap_sr"]]

    def factors(own: pd.DataFrame) -> str:
        return " / ".join(f"{time / own['seconds.total'].iloc[0]:.0f}" for time in full)

    return f"{_of_methods(lines, factors)} times as fast as `{'` / `'.join(full.index)}`"


def _large(lines: pd.DataFrame) -> str:
    size = min(lines["vertices"].unique(), key=lambda n: abs(math.log(n / LARGE)))
    return f"{_seconds(lines[lines['vertices'] == size])} ({size:,.0f} vertices)"


def _transfer(lines: pd.DataFrame) -> str:
    line = lines.iloc[0]
    return f"{line['seconds.total']:.2g} s ({line['vertices']:,.0f} vertices, ten samplings)"


def _linear(lines: pd.DataFrame) -> str:
    """Compare the largest mesh with the mesh that is nearest to the claim on large meshes."""
    sizes = sorted(lines["vertices"].unique())
    low, high = min(sizes, key=lambda n: abs(math.log(n / LARGE))), sizes[-1]

    def growth(own: pd.DataFrame) -> str:
        times = own.set_index("vertices")["seconds.total"]
        return f"{times[high] / times[low]:.1f}"

    text = _of_methods(lines, growth)
    return f"{high / low:.1f} times the vertices ({low:,.0f} to {high:,.0f}) take {text} times as long"


def _of_methods(lines: pd.DataFrame, text: Callable[[pd.DataFrame], str]) -> str:
    """Return a text for each method of the paper, as published and with our solver."""
    return ", ".join(f"`{name}` {text(lines[lines['method'] == name])}" for name in ("paper_plain", "paper"))

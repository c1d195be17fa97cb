"""What pages of results share: tables, figures and facts of rows as HTML, and how templates are filled."""

from __future__ import annotations

import base64
import re
from importlib.resources import files
from typing import Any

import pandas as pd

from eval.publish.plotting import to_svg
from eval.publish.summary import Table
from eval.publish.tables import cells
from eval.rows.frame import distinct, records

#: Facts about runs that pages tell, and their headings.
FACTS = {
    "env.machine": "machine",
    "env.python": "Python",
    "env.commit": "commit",
    "env.modified": "with changes to it",
    "env.numba_threads": "threads of numba",
    "env.omp_num_threads": "threads of OpenMP",
    "env.jobs": "runs at once",
}


def style() -> str:
    """The style sheet of all pages."""
    return files("eval.publish").joinpath("style.css").read_text(encoding="utf-8")


def environment(**options: Any) -> Any:
    """jinja2's, with everything escaped, and no name left undefined."""
    from jinja2 import Environment, StrictUndefined

    return Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, **options
    )


def views(table: Table) -> list[dict[str, Any]]:
    """The tables of a :class:`Table` as headings and cells of HTML."""
    from markupsafe import escape

    marks = {0: "{}", 1: '<b title="best">{}</b>', 2: '<u title="second best">{}</u>'}
    form = {"not_available": "n/a", "escape": lambda text: str(escape(text))}
    return [
        {
            "title": title,
            "labels": ["method", "runs", *(column.label for column in columns)],
            "body": cells(table, columns, marks, **form),
        }
        for title, columns in table.views
    ]


def charts(figures: dict[str, Any]) -> dict[str, str]:
    """Figures as data URIs, by name."""
    packed = {name: base64.b64encode(to_svg(figure).encode()) for name, figure in figures.items()}
    return {name: f"data:image/svg+xml;base64,{data.decode('ascii')}" for name, data in packed.items()}


def configuration(rows: pd.DataFrame, method: str) -> str:
    """A method's settings as YAML, nested as in its configuration."""
    import yaml

    row = records(rows[rows["method.name"] == method])[0]
    nested: dict[str, Any] = {}
    for column, value in row.items():
        group, _, name = column.partition(".")
        if group != "method" or name in ("name", "hash", "note", "sources"):
            continue
        *parents, last = name.split(".")
        place = nested
        for parent in parents:
            place = place.setdefault(parent, {})
        # A column that only other methods fill is none of this one's settings.
        place["_target_" if last == "target" else last] = value
    text = yaml.safe_dump(_pruned(nested), sort_keys=False, default_flow_style=False)
    return f"# configuration {row['method.hash']}, code {row.get('env.version.code')}\n{text}"


def _pruned(settings: dict[str, Any]) -> dict[str, Any]:
    """Settings without empty ones, the function first."""
    kept = {
        name: _pruned(value) if isinstance(value, dict) else value
        for name, value in settings.items()
        if value is not None
    }
    return dict(sorted(((n, v) for n, v in kept.items() if v != {}), key=lambda pair: pair[0] != "_target_"))


def facts(rows: pd.DataFrame) -> list[tuple[str, str]]:
    """Where and when the rows were made; several values are listed."""
    told = []
    for column, heading in FACTS.items():
        values = distinct(rows, column)
        if len(values) > 4 and all(isinstance(value, (int, float)) for value in values):
            told.append((heading, f"{values[0]:g} to {values[-1]:g}"))
        elif values:
            told.append((heading, ", ".join(map(_word, values))))
    for column in sorted(name for name in rows if name.startswith("env.version.")):
        told.append((column.removeprefix("env.version."), ", ".join(distinct(rows, column))))
    days = sorted({date[:10] for date in distinct(rows, "date")})
    return [("dates", " to ".join(dict.fromkeys(days[:1] + days[-1:]))), *told]


def _word(value: Any) -> str:
    """A fact as text: a bool in words, a commit by its beginning."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    text = str(value)
    return text[:12] if re.fullmatch("[0-9a-f]{40}", text) else text

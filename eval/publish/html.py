"""Parts of HTML pages of results: tables, figures, configurations and facts of rows."""

from __future__ import annotations

import ast
import base64
import html
import re
from collections.abc import Sequence
from functools import partial
from typing import Any

import pandas as pd

from eval.publish.columns import Column
from eval.publish.notes import definitions, legend
from eval.publish.plotting import to_svg
from eval.publish.tables import TIE, printed
from eval.rows.frame import distinct, records
from eval.rows.store import Row

#: Columns of facts about runs, and their headings.
FACTS = {
    "env.machine": "machine",
    "env.python": "Python",
    "env.commit": "commit",
    "env.modified": "with changes to it",
    "env.numba_threads": "threads of numba",
    "env.omp_num_threads": "threads of OpenMP",
    "env.jobs": "runs at once",
}


def render(template: str, **names: Any) -> str:
    """Return a page from a template of this package. All text is escaped; undefined names are refused."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    blocks = {"trim_blocks": True, "lstrip_blocks": True}
    loader = PackageLoader("eval", "")
    pages = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, **blocks)
    marks = {0: "{}", 1: '<b title="best">{}</b>', 2: '<u title="second best">{}</u>'}
    marks[TIE] = '<i title="may be zero">{}</i>'
    pages.globals["printed"] = partial(printed, marks=marks, not_available="n/a", escape=html.escape)
    pages.globals |= {"legend": legend, "definitions": definitions}
    return pages.get_template(template).render(**names)


def texts(row: Row, columns: Sequence[Column]) -> list[str]:
    """Return the printed numbers of a row."""
    return ["n/a" if row.get(c.source) is None else c.text(row[c.source]) for c in columns]


def svg_uri(figure: Any) -> str:
    """Return a figure as a data URI."""
    return f"data:image/svg+xml;base64,{base64.b64encode(to_svg(figure).encode()).decode('ascii')}"


def configuration(rows: pd.DataFrame, method: str) -> str:
    """Return the settings of a method as YAML, nested as in its configuration.

    A setting that the method resolves by the case, such as a default for regions, has all of its values.
    """
    import yaml

    own = rows[rows["method.name"] == method]
    row = records(own)[0]
    found = {name: list(own[name].dropna().unique()) for name in own if name.startswith("method.")}
    # A setting without a value belongs to another method.
    names = {name for name, values in found.items() if values}
    names -= {f"method.{fact}" for fact in ("name", "hash", "note", "version")}
    settings: dict[str, Any] = {}
    for name in sorted(names, key=_function_first):
        _, *parents, last = name.split(".")
        place = settings
        for parent in parents:
            place = place.setdefault(parent, {})
        value = found[name][0]
        if len(found[name]) > 1:
            value = f"{' or '.join(map(str, found[name]))}, by the case"
        elif isinstance(value, str) and value.startswith("["):  # rows hold lists as text
            value = ast.literal_eval(value)
        place["_target_" if last == "target" else last] = value
    text = yaml.safe_dump(settings, sort_keys=False, default_flow_style=False)
    return f"# version {row['method.version']}, hash {row['method.hash']}\n{text}"


def _function_first(name: str) -> list[str]:
    return ["" if part == "target" else part for part in name.split(".")]


def facts(rows: pd.DataFrame) -> list[tuple[str, str]]:
    """Return when and where the rows were made; several values are listed."""
    found = []
    for column, heading in FACTS.items():
        values = distinct(rows, column)
        if len(values) > 4 and all(isinstance(value, (int, float)) for value in values):
            found.append((heading, f"{values[0]:g} to {values[-1]:g}"))
        elif values:
            found.append((heading, ", ".join(map(_word, values))))
    for column in sorted(name for name in rows if name.startswith("env.version.")):
        found.append((column.removeprefix("env.version."), ", ".join(distinct(rows, column))))
    days = sorted({date[:10] for date in distinct(rows, "date")})
    return [("dates", " to ".join(dict.fromkeys(days[:1] + days[-1:]))), *found]


def _word(value: Any) -> str:
    """Return a fact as text: a bool as a word, the beginning of a commit."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    text = str(value)
    return text[:12] if re.fullmatch("[0-9a-f]{40}", text) else text

"""Names that methods, options and facts had in earlier versions.

Committed rows are read under the new names. On the command line, the error about an old name gives the new
one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from sshade.errors import InputError

#: Old name of a method -> new name, in rows and in ``conf/method``.
METHODS = {
    "sshade": "paper",
    "sshade_paper": "paper_plain",
    "sshade_fast": "fast",
    "sshade_fine": "fine",
    "sshade_fine_free": "fine_free",
    "sshade_residual": "residual",
}
#: Old name of an option -> new name; also options of a nested method, ``method.coarse.parts``.
OPTIONS = {"parts": "attachment", "proxy_parts": "proxy_attachment", "limit": "strain_limit"}
#: Old column of a row -> new column and the new names of its values.
FACTS = {
    "extra.proxy_basin": ("extra.proxy_initialisation", {"lead": "guide", "start": "handles"}),
}

#: An old method in a label: ``sshade_fine-0.1``, or ``sshade deform --method sshade_fast``.
_IN_LABEL = re.compile(r"(?:^|(?<= ))sshade\w*(?=-|$)")


def new_label(label: str) -> str:
    """Return the label of a method with the new name of the method."""
    return _IN_LABEL.sub(lambda found: METHODS.get(found[0], found[0]), label)


def new_column(column: str) -> str:
    """Return the new name of a column."""
    if column in FACTS:
        return FACTS[column][0]
    path, _, option = column.rpartition(".")
    if path.split(".")[0] == "method" and option in OPTIONS:
        return f"{path}.{OPTIONS[option]}"
    return column


def with_new_names(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row under the new names of its method, options and facts."""
    renamed = {}
    for column, value in row.items():
        values = FACTS[column][1] if column in FACTS else {}
        renamed[new_column(column)] = values.get(value, value)
    if isinstance(name := row.get("method.name"), str):
        renamed["method.name"] = new_label(name)
    return renamed


def refuse_old_methods(names: Iterable[str]) -> None:
    """Raise InputError, with the new name, on the old name of a method in ``conf/method``."""
    for name in names:
        group, slash, method = name.rpartition("/")
        if method in METHODS:
            new = f"{group}{slash}{METHODS[method]}"
            raise InputError(f"the method {name} is now named {new}; write {new} in place of {name}")

"""Names that methods, options and facts had in earlier versions.

Committed rows are read under the new names. On the command line, the error about an old name gives the new
one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from sshade.errors import InputError
from sshade.options import OLD_METHODS, OLD_NAMES

#: Old name of a method -> new name, in rows and in ``conf/method``.
METHODS = {**OLD_METHODS, "sshade_residual": "residual"}
#: Old name of a part that the ablation of ``fast`` leaves out -> new name.
LEFT_OUT = {
    "held_volume": "constraints",
    "parts": "attachment",
    "lead": "guide",
    "parts_and_lead": "attachment_and_guide",
}
#: Old column of a row -> new column and the new names of its values.
FACTS = {
    "extra.proxy_basin": ("extra.proxy_initialisation", {"lead": "guide", "start": "handles"}),
    "method.without": ("method.without", LEFT_OUT),
}

#: An old method in a label: ``sshade_fine-0.1``, or ``sshade deform --method sshade_fast``.
_IN_LABEL = re.compile(r"(?:^|(?<= ))sshade\w*(?=-|$)")


def new_label(label: str) -> str:
    """Return the label of a method with the new name of the method."""
    prefix, _, left_out = label.partition("_")
    if prefix == "without" and left_out in LEFT_OUT:
        return f"without_{LEFT_OUT[left_out]}"
    return _IN_LABEL.sub(lambda found: METHODS.get(found[0], found[0]), label)


def new_column(column: str) -> str:
    """Return the new name of a column."""
    if column in FACTS:
        return FACTS[column][0]
    path, _, option = column.rpartition(".")
    if path.split(".")[0] == "method" and option in OLD_NAMES:
        return f"{path}.{OLD_NAMES[option]}"
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


def refuse_old_names(setting: str, values: Iterable[str] = ()) -> None:
    """Raise InputError, with the new name, on the old name of an option or of a method in ``conf/method``.

    Parameters
    ----------
    setting : str
        ``method``, ``method@method.coarse``, or an option such as ``method.volume``.
    values : iterable of str
        Names of methods, if the setting chooses methods.
    """
    if (new := new_column(setting)) != setting:
        raise InputError(f"the option {setting} is now named {new}; write {new} in place of {setting}")
    for name in values if setting.partition("@")[0] == "method" else ():
        group, slash, method = name.rpartition("/")
        if method in METHODS:
            new = f"{group}{slash}{METHODS[method]}"
            raise InputError(f"the method {name} is now named {new}; write {new} in place of {name}")

"""Check plain values of a configuration, as YAML gives them, against a schema.

A schema is

- ``int``, ``float`` (any finite number), ``str``, ``bool`` or ``None``;
- ``[item]``, a list of any length, or ``[a, b, ...]``, a list of exactly these items;
- ``{"key": schema}``, an object with some of these keys, or ``{str: schema}``, an object with any keys;
- a tuple of alternatives.
"""

from __future__ import annotations

import sys
from itertools import repeat
from reprlib import repr as shortened
from typing import Any

_WORDS: dict[type | None, str] = {
    int: "a whole number",
    float: "a number",
    str: "a text",
    bool: "true or false",
    None: "null",
    list: "a list",
    dict: "an object",
}


def mismatch(value: Any, schema: Any, place: str = "") -> str:
    """Describe the first place where a value differs from a schema.

    Parameters
    ----------
    value
        A plain value: numbers, texts, lists and mappings.
    schema
        See the head of this module.
    place : str
        Name of the value in the answer; "it" by default.

    Returns
    -------
    str
        Empty if the value fits.
    """
    if isinstance(schema, tuple):
        found = [mismatch(value, alternative, place) for alternative in schema]
        return "" if "" in found else found[0]
    kind: type | None = type(schema) if isinstance(schema, (list, dict)) else schema
    if not _is(value, kind):
        return f"{place or 'it'} is {shortened(value)}, not {_WORDS[kind]}"
    inside: list[tuple[Any, Any, str]] = []
    if kind is list:
        if len(schema) > 1 and len(value) != len(schema):
            return f"{place or 'it'} has {len(value)} items, not {len(schema)}"
        items = schema if len(schema) > 1 else repeat(schema[0])
        inside = [(v, s, f"{place}[{i}]") for i, (v, s) in enumerate(zip(value, items, strict=False))]
    elif kind is dict:
        inside = [
            (v, schema[str if str in schema else key], f"{place}.{key}" if place else key)
            for key, v in value.items()
        ]
    return next(filter(None, (mismatch(*each) for each in inside)), "")


def _is(value: Any, kind: type | None) -> bool:
    if kind is float:
        return type(value) in (int, float) and abs(value) <= sys.float_info.max
    return value is None if kind is None else type(value) is kind

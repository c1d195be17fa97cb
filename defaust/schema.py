"""Checks plain values, as JSON and YAML give them, against a schema before anything uses them.

A schema is

- ``int``, ``float`` (any finite number), ``str``, ``bool`` or ``None``;
- ``[item]``, a list of any length, or ``[a, b, ...]``, one of just these items;
- ``{"key": schema, "other?": schema}``, an object: a key with ``?`` may be missing, and keys that are
  not named are left alone; ``{str: schema}``, one with any keys;
- a tuple of schemas, of which one must fit.
"""

from __future__ import annotations

import sys
from itertools import repeat
from reprlib import repr as shortened
from typing import Any

_WORDS = {
    int: "a whole number",
    float: "a number",
    str: "a text",
    bool: "true or false",
    None: "null",
    list: "a list",
    dict: "an object",
}


def mismatch(value: Any, schema: Any, place: str = "") -> str:
    """The first place where a value is not as the schema wants it, in words; empty where it fits.

    Parameters
    ----------
    value
        A plain value: numbers, texts, lists and mappings of them.
    schema
        See the head of this module.
    place : str
        What the value is called in the answer; "it" by default.
    """
    if isinstance(schema, tuple):
        found = [mismatch(value, one, place) for one in schema]
        return "" if "" in found else found[0]
    kind = type(schema) if isinstance(schema, (list, dict)) else schema
    if not _is(value, kind):
        return f"{place or 'it'} is {shortened(value)}, not {_WORDS[kind]}"
    inside: list[tuple[Any, Any, str]] = []
    if kind is list:
        if len(schema) > 1 and len(value) != len(schema):
            return f"{place or 'it'} has {len(value)} items, not {len(schema)}"
        items = schema if len(schema) > 1 else repeat(schema[0])
        inside = [(v, s, f"{place}[{i}]") for i, (v, s) in enumerate(zip(value, items, strict=False))]
    elif kind is dict:
        keys = dict.fromkeys(value, schema[str]) if str in schema else schema
        for key, one in keys.items():
            name = key if key in value else key.removesuffix("?")
            at = f"{place}.{name}" if place else name
            if name in value:
                inside.append((value[name], one, at))
            elif name == key:
                return f"it has no {at}"
    return next(filter(None, (mismatch(*each) for each in inside)), "")


def _is(value: Any, kind: type | None) -> bool:
    if kind is float:
        return type(value) in (int, float) and abs(value) <= sys.float_info.max
    return value is None if kind is None else type(value) is kind

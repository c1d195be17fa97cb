"""Refuse unknown keys of files that people write by hand."""

from __future__ import annotations

import json
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any

from sshade.errors import InputError
from sshade.io.text import decoded

#: Users' own keys begin with this character, and are ignored.
OWN = "_"
#: Greatest length of a key in a message.
LONGEST = 40


def require_known(keys: Iterable[Any], known: tuple[str, ...], ignored: tuple[str, ...] = ()) -> None:
    """Raise InputError if a key is neither known nor ignored, nor begins with :data:`OWN`."""
    for key in keys:
        if key not in known and key not in ignored and not str(key).startswith(OWN):
            short = str(key)[:LONGEST]
            near = get_close_matches(short, known, n=1, cutoff=0.0)[0]
            meant = f'did you mean "{near}"? Keys of your own begin with {OWN}'
            raise InputError(f"there is no key {json.dumps(short)}; {meant}")


def parsed_json(content: bytes) -> Any:
    """Return the content of a JSON text; raise InputError if it is none, or an object has a key twice."""
    try:
        return json.loads(decoded(content), object_pairs_hook=unique_keys)
    except (ValueError, RecursionError, InputError) as error:
        why = "nested too deeply" if isinstance(error, RecursionError) else error
        raise InputError(f"not readable as JSON ({why})") from error


def unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return pairs of keys and values as a dict; raise InputError if a key occurs twice."""
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise InputError(f"the key {json.dumps(twice[:LONGEST])} occurs twice in one object")
    return found

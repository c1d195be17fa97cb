"""Parse files that people write by hand, JSON and YAML, and refuse unknown keys."""

from __future__ import annotations

import json
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any

from sshade.core.errors import InputError

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


def decoded(content: bytes) -> str:
    """Decode UTF-8, UTF-16 or UTF-32, with or without a byte-order mark, which is dropped.

    Raises
    ------
    InputError
        When the bytes are text in none of these encodings.
    """
    try:
        return content.decode(json.detect_encoding(content))
    except UnicodeDecodeError as error:
        raise InputError("it is neither UTF-8 nor UTF-16 text; save it as UTF-8") from error


def parsed_list(content: bytes, name: str) -> dict[str, Any]:
    """Return the object of a JSON text, which has a list `name`; raise InputError if it has none."""
    data = parsed_json(content)
    if not isinstance(data, dict) or not isinstance(data.get(name), list):
        raise InputError(f'expected an object with a list "{name}"')
    return data


def parsed_json(content: bytes) -> Any:
    """Return the content of a JSON text; raise InputError if it is none, or an object has a key twice."""
    try:
        return json.loads(decoded(content), object_pairs_hook=unique_keys)
    except (ValueError, RecursionError, InputError) as error:
        why = "nested too deeply" if isinstance(error, RecursionError) else error
        raise InputError(f"not readable as JSON ({why})") from error


def parsed_yaml(content: bytes) -> Any:
    """Return the content of a YAML text; raise InputError if it is none, or has a key of the text twice.

    An empty text is an empty mapping.
    """
    import yaml

    try:
        text = decoded(content)
        # PyYAML keeps the last of several equal keys, so the keys are compared before it joins them.
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        if isinstance(node, yaml.MappingNode):
            unique_keys([(str(key.value), None) for key, _ in node.value])
        data = yaml.safe_load(text)
        return {} if data is None else data
    except (yaml.YAMLError, ValueError, RecursionError, InputError) as error:
        # PyYAML calls a text by this name.
        why = " ".join(str(error).split()).replace(' in "<unicode string>",', " in")
        why = "nested too deeply" if isinstance(error, RecursionError) else why
        raise InputError(f"not readable as YAML ({why})") from error


def unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return pairs of keys and values as a dict; raise InputError if a key occurs twice."""
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise InputError(f"the key {json.dumps(twice[:LONGEST])} occurs twice in one object")
    return found

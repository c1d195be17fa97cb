"""Parse files that people write by hand, JSON and YAML, and refuse unknown keys; read files of options."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from sshade.core.errors import InputError
from sshade.files.atomic import naming
from sshade.files.mesh_file import check_input

#: Users' own keys begin with this character, and are ignored.
OWN = "_"
#: Greatest length of a key in a message.
LONGEST = 40
#: Suffixes of files of options.
OPTION_FORMATS = (".yaml", ".yml", ".json")


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


def read_option_file(path: Path, names: Collection[str]) -> dict[Any, Any]:
    """Return the names and values in a file, unchecked.

    A handle file has them under its key ``made``, which the editor writes for ``sshade deform``: options
    outside of `names` are left out there.

    Raises
    ------
    InputError
        When the file is missing, of another format, no mapping, or a handle file without options.
    """
    check_input(path, OPTION_FORMATS)
    content = path.read_bytes()
    with naming(path):
        data = parsed_json(content) if path.suffix.lower() == ".json" else parsed_yaml(content)
        if isinstance(data, dict) and "handles" in data:
            if not isinstance(data.get("made"), dict):
                raise InputError(
                    'it has handles and no options; the editor saves options under the key "made"'
                )
            return {name: value for name, value in data["made"].items() if name in names}
        if not isinstance(data, dict):
            raise InputError("expected names and values of options, such as `volume: 0`")
        return data

"""Files that people write by hand, JSON and YAML: their keys and their lists of numbers."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import numpy as np

from sshade.core.errors import InputError, meant

#: Users' own keys begin with this character, and are ignored.
OWN = "_"
#: Greatest length of a key in a message.
LONGEST = 40


def require_known(keys: Iterable[Any], known: tuple[str, ...], ignored: tuple[str, ...] = ()) -> None:
    """Raise InputError if a key is neither known nor ignored, nor begins with :data:`OWN`."""
    for key in keys:
        if key not in known and key not in ignored and not str(key).startswith(OWN):
            short = str(key)[:LONGEST]
            hint = meant(short, known) or f"; the keys are {', '.join(known)}."
            raise InputError(f"there is no key {json.dumps(short)}{hint} Keys of your own begin with {OWN}")


def decoded(content: bytes) -> str:
    """Decode UTF-8, UTF-16 or UTF-32, with or without a byte-order mark, which is dropped.

    Raises
    ------
    InputError
        When the bytes are no text in these encodings.
    """
    try:
        return content.decode(json.detect_encoding(content))
    except UnicodeDecodeError as error:
        raise InputError("it is neither UTF-8 nor UTF-16 text; save it as UTF-8") from error


def parsed_list(content: bytes, name: str) -> dict[str, Any]:
    """Return the object of a JSON text, which has a list `name`; raise InputError if it has none."""
    try:
        data = json.loads(decoded(content))
    except (ValueError, RecursionError) as error:
        why = "nested too deeply" if isinstance(error, RecursionError) else error
        raise InputError(f"not readable as JSON ({why})") from error
    if not isinstance(data, dict) or not isinstance(data.get(name), list):
        raise InputError(f'expected an object with a list "{name}"')
    return data


def parsed_yaml(content: bytes) -> Any:
    """Return the content of a YAML text, {} for an empty text; raise InputError if it is none."""
    import yaml

    try:
        data = yaml.safe_load(decoded(content))
        return {} if data is None else data
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        # PyYAML calls a text by this name.
        why = " ".join(str(error).split()).replace(' in "<unicode string>",', " in")
        why = "nested too deeply" if isinstance(error, RecursionError) else why
        raise InputError(f"not readable as YAML ({why})") from error


def as_ids(values: Any, name: str) -> np.ndarray:
    """Convert a list of vertex ids to a (k,) int64 array.

    Raises
    ------
    InputError
        When it is no list of integers, or empty.
    """
    return _numbers(values, name, (None,), "a list of integers, at least one", kinds="i").astype(np.int64)


def as_points(values: Any, name: str) -> np.ndarray:
    """Convert a list of points to a (k, 3) array; see :func:`as_array`."""
    return as_array(values, name, (None, 3), "a list of points [x, y, z]")


def as_boxes(values: Any, name: str) -> np.ndarray:
    """Convert a list of boxes, pairs of their lowest and highest corners, to a (b, 2, 3) array."""
    return as_array(values, name, (None, 2, 3), "a list of pairs of points")


def as_array(values: Any, name: str, shape: tuple[int | None, ...], form: str) -> np.ndarray:
    """Convert numbers to a float64 array.

    Parameters
    ----------
    values : list
    name, form : str
        Name of the list and its form, for messages.
    shape : tuple
        None stands for any length but 0.

    Raises
    ------
    InputError
        When the numbers have another shape or are not finite.
    """
    array = _numbers(values, name, shape, form, kinds="iuf").astype(np.float64)
    if not np.isfinite(array).all():
        raise InputError(f"{name} has a NaN or infinite position")
    return array


def _numbers(values: Any, name: str, shape: tuple[int | None, ...], form: str, *, kinds: str) -> np.ndarray:
    """Return lists of numbers as an array; raise InputError on another shape, or another kind of NumPy's."""
    try:
        array = np.asarray(values)
    except ValueError:  # lists of several lengths
        array = np.zeros(0)
    fits = array.ndim == len(shape) and all(a in (None, b) for a, b in zip(shape, array.shape, strict=True))
    # Texts, true, null, and integers of many digits make arrays of other kinds.
    if not fits or array.size == 0 or array.dtype.kind not in kinds:
        raise InputError(f"{name} must be {form}")
    return array

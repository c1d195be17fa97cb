"""Files of options for ``--options``: names and values, or a handle file that the editor saved."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import Any

from sshade.core.atomic import naming
from sshade.core.errors import InputError
from sshade.files.handwritten import parsed_json, parsed_yaml, require_known
from sshade.files.mesh_file import check_input
from sshade.mesh.weld import check_weld
from sshade.problem.options import described, require_method

#: Suffixes of files of options.
OPTION_FORMATS = (".yaml", ".yml", ".json")


def read_values(path: Path, names: tuple[str, ...]) -> dict[str, Any]:
    """Return the valid values of a file of options.

    Raises
    ------
    InputError
        When the file cannot be read, a name is not one of `names`, or a value is out of its range.
    """
    given = _given(path, names)
    with naming(path):
        require_known(given, names)
        known = {name: given[name] for name in names if given.get(name) is not None}
        return {name: _checked(name, value) for name, value in known.items()}


def _given(path: Path, names: Collection[str]) -> dict[Any, Any]:
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


def _checked(name: str, value: Any) -> Any:
    """Return a valid value of a file of options, and raise InputError on any other."""
    option = described().get(name)
    if name == "method" or (option is not None and option.choices):
        if not isinstance(value, str):
            raise InputError(f"{name} must be a name, not {value!r}")
        return option.checked(name, value) if option else require_method(value)
    # YAML takes 1e-5 and inf for words.
    if isinstance(value, str | int) and not isinstance(value, bool):
        with suppress(ValueError):
            value = as_number(str(value))
    if option is not None:
        return option.checked(name, value)
    if name not in ("weight", "weld"):
        valid, values = isinstance(value, bool), "true or false"
    else:
        valid, values = isinstance(value, int | float) and not isinstance(value, bool), "a number"
        if valid and name == "weld":
            check_weld(value)
        elif name == "weight":
            valid, values = valid and value > 0, "a number above 0"
    if not valid:
        raise InputError(f"{name} must be {values}, not {value!r}")
    return value


def as_number(text: str) -> float:
    """Convert a text to a number, and keep whole numbers that a float can hold as int for later checks."""
    return int(text) if text.lstrip("-").isdigit() and len(text) < 300 else float(text)

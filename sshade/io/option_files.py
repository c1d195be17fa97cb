"""Read files of options: a mapping of names and values, or a handle file that the editor saved."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

from sshade.errors import InputError
from sshade.io.document import check_input
from sshade.io.files import naming
from sshade.io.keys import parsed_json, unique_keys
from sshade.io.text import decoded

#: Suffixes of files of options.
FORMATS = (".yaml", ".yml", ".json")


def read_option_file(path: Path, names: Collection[str]) -> dict[Any, Any]:
    """Return the names and values in a file, unchecked.

    A handle file has them under its key ``made``, which the editor writes for ``sshade deform``: options
    outside of `names` are left out there.

    Raises
    ------
    InputError
        When the file is missing, of another format, no mapping, or a handle file without options.
    """
    check_input(path, FORMATS)
    content = path.read_bytes()
    with naming(path):
        data = parsed_json(content) if path.suffix.lower() == ".json" else _parsed_yaml(decoded(content))
        if isinstance(data, dict) and "handles" in data:
            if not isinstance(data.get("made"), dict):
                raise InputError(
                    'it has handles and no options; the editor saves options under the key "made"'
                )
            return {name: value for name, value in data["made"].items() if name in names}
        if not isinstance(data, dict):
            raise InputError("expected names and values of options, such as `volume: 0`")
        return data


def _parsed_yaml(text: str) -> Any:
    """Return the content of a YAML text. An empty text is an empty mapping."""
    import yaml

    try:
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

"""Read files of options: a mapping of names and values, or a handle file that the editor saved."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

from sshade.core.errors import InputError
from sshade.files.atomic import naming
from sshade.files.document import check_input
from sshade.files.keys import parsed_json, parsed_yaml

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

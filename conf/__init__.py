"""The YAML files of methods, datasets, experiments and builds, and which functions they name."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable

#: Keys whose value is the dotted name of a function to call.
CALLED = ("_target_", "cases")
_NAMES = re.compile(rf"^\s*(?:{'|'.join(CALLED)})\s*:\s*[\"']?([\w.]+)", re.MULTILINE)


@cache
def named_functions() -> frozenset[str]:
    """Dotted names of the functions that files of this package name: these may be called.

    A name that comes from elsewhere, as from a folder of configurations or of
    results that was received from others, could name any function there is.
    """
    texts = (file.read_text(encoding="utf-8") for file in _files(resources.files(__name__)))
    return frozenset(name for text in texts for name in _NAMES.findall(text))


def told(text: str) -> str:
    """Hydra's complaint in one sentence: without its search path and its hints for programmers."""
    text = re.sub(r"\s+", " ", text.split("Config search path")[0]).strip()
    choice = re.search(r"Could not find '(.+)/([^/']+)' Available options in '[^']*': (.+)", text)
    if choice:
        group, name, known = choice.groups()
        return f"there is no {group} {name!r}; choose one of {', '.join(known.split())}"
    setting = re.match(r"Could not override '([^']+)'\. To append", text)
    return f"there is no setting {setting[1]}" if setting else text


def _files(folder: Traversable) -> Iterator[Traversable]:
    for path in folder.iterdir():
        if path.is_dir():
            yield from _files(path)
        elif path.name.endswith(".yaml"):
            yield path

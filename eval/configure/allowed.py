"""Which functions a configuration or a row may name.

A name such as ``os.system`` would do harm where a folder of configurations, or
of results, comes from others. Called are only functions that a file of the
project's ``conf`` names (so a method of one's own is added there), and those
that the command line allows: ``run.allow_targets=[mypackage.]``, or for the
commands that read rows the environment variable ``EVAL_ALLOW_TARGETS``.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from sshade.cli.configuration import CALLED, named_functions
from sshade.errors import InputError

#: Beginnings of names, separated by commas. Processes of a launcher inherit it.
VARIABLE = "EVAL_ALLOW_TARGETS"
#: The same on the command line of ``sshade-eval run``; a YAML file that sets it is refused.
OVERRIDE = "run.allow_targets"

_SEARCH_PATH = "hydra.searchpath"


def require_allowed(config: Any, *, where: str) -> None:
    """Check every function that a configuration names, at any depth.

    Parameters
    ----------
    config : mapping, list or plain value
    where : str
        For the message: what the configuration is of.

    Raises
    ------
    InputError
        On a name that no file of ``conf`` has nor the user allowed.
    """
    for name in _names(config):
        if not is_allowed(name):
            top = str(name).split(".")[0]
            raise InputError(
                f"{where} names the function {name}, which no file of conf names; if you trust it, give "
                f"{OVERRIDE}=[{top}.] on the command line, or set {VARIABLE}={top}."
            )


def is_allowed(name: Any) -> bool:
    """Whether a function of that dotted name may be called."""
    beginnings = [text for text in os.environ.get(VARIABLE, "").split(",") if text]
    return isinstance(name, str) and (
        name in named_functions() or any(name == text or name.startswith(text) for text in beginnings)
    )


def allow_from(arguments: Sequence[str]) -> None:
    """Take ``run.allow_targets`` over from a command line, for this process and those that it starts."""
    for argument in arguments:
        name, _, value = argument.lstrip("+").partition("=")
        if name == OVERRIDE:
            texts = [text.strip(" '\"") for text in value.strip(" []").split(",")]
            os.environ[VARIABLE] = ",".join([os.environ.get(VARIABLE, ""), *texts]).strip(",")


def require_from_command_line(texts: Any) -> None:
    """Raise InputError where a composed configuration allows what the command line did not."""
    given = os.environ.get(VARIABLE, "").split(",")
    wrong = [text for text in texts if text not in given] if isinstance(texts, list) else [texts]
    if texts is not None and wrong:
        raise InputError(f"{OVERRIDE} is for the command line alone, not for a YAML file ({wrong[0]})")


def check_folders(folders: Iterable[str | None], *, overrides: Sequence[str] = ()) -> None:
    """Check the YAML files of folders that a command line adds to the configuration.

    Hydra itself calls what they name as launcher, sweeper or callback.

    Parameters
    ----------
    folders : iterable of str or None
        Of ``--config-dir`` and ``--config-path``.
    overrides : sequence of str
        Where ``hydra.searchpath`` names more.

    Raises
    ------
    InputError
        On a name that is not allowed, a file that is no YAML, or one that adds folders itself.
    """
    found = [folder for folder in folders if folder]
    for override in overrides:
        name, _, value = override.lstrip("+").partition("=")
        if name == _SEARCH_PATH:
            found += [text.strip(" '\"") for text in value.strip(" []").split(",")]
    for folder in found:
        for path in sorted(Path(folder.removeprefix("file://")).rglob("*.yaml")):
            _check_file(path)


def _check_file(path: Path) -> None:
    import yaml

    try:
        documents = list(yaml.safe_load_all(path.read_text(encoding="utf-8")))
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{path}: not readable as YAML ({' '.join(str(error).split())[:200]})") from error
    if "searchpath" in _keys(documents):
        raise InputError(
            f"{path}: it adds a search path; give {_SEARCH_PATH}=[DIR] on the command line instead"
        )
    require_allowed(documents, where=str(path))


def _keys(config: Any) -> Iterator[Any]:
    if isinstance(config, Mapping):
        for key, value in config.items():
            yield key
            yield from _keys(value)
    elif isinstance(config, (list, tuple)):
        for value in config:
            yield from _keys(value)


def _names(config: Any) -> Iterator[Any]:
    if isinstance(config, Mapping):
        for key, value in config.items():
            if key in CALLED and not isinstance(value, Mapping):
                yield value
            else:
                yield from _names(value)
    elif isinstance(config, (list, tuple)):
        for value in config:
            yield from _names(value)

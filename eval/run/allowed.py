"""Which functions and programs a configuration or a row may name.

A name such as ``os.system`` in a folder of configurations or results from another person would do harm.
Therefore only two kinds of functions are called: functions that a file of the project's ``conf`` names, and
functions that the user allows. The user allows functions on the command line, with
``run.allow_targets=[mypackage.]``, or in the environment variable ``EVAL_ALLOW_TARGETS``.

The method ``external`` runs a program. The user allows the whole command (:mod:`sshade.programs`). The method
itself asks again before each start, whoever called it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from eval.run.targets import EXTERNAL
from sshade.cli.configuration import CALLED, named_functions
from sshade.core.errors import InputError
from sshade.programs import require_permission

#: Variable with prefixes of allowed names, separated by commas. Workers of a launcher inherit it.
VARIABLE = "EVAL_ALLOW_TARGETS"
#: Setting with the same meaning on the command line of ``sshade-eval run``; a YAML file cannot set it.
OVERRIDE = "run.allow_targets"

#: Settings of Hydra that name code: folders of configurations, variables such as PYTHONPATH, shell commands.
_RESERVED = ("searchpath", "env_set", "setup")


def require_allowed(config: Any, *, where: str) -> None:
    """Check every function that a configuration names, at any depth.

    Parameters
    ----------
    config : mapping, list or plain value
    where : str
        Origin of the configuration, for the message.

    Raises
    ------
    InputError
        On a function that neither a file of ``conf`` nor the user names.
    """
    prefixes = tuple(text for text in os.environ.get(VARIABLE, "").split(",") if text)
    for key, name in _items(config):
        if key not in CALLED or isinstance(name, Mapping):
            continue
        if not isinstance(name, str) or not (name in named_functions() or name.startswith(prefixes)):
            top = str(name).split(".")[0]
            raise InputError(
                f"{where} names the function {name}, which no file of conf names; if you trust it, give "
                f"{OVERRIDE}=[{top}.] on the command line, or set {VARIABLE}={top}."
            )


def require_programs(config: Any, *, where: str) -> None:
    """Check every program that a resolved configuration runs, at any depth.

    Raises
    ------
    InputError
        On a command that the user has not allowed.
    """
    if isinstance(config, Mapping):
        if config.get("_target_") == EXTERNAL:
            require_permission(config.get("command"), where=where)
        config = list(config.values())
    for value in config if isinstance(config, (list, tuple)) else ():
        require_programs(value, where=where)


def allow_functions(prefixes: Iterable[str]) -> None:
    """Allow functions by the first letters of their names, for this process and its child processes."""
    os.environ[VARIABLE] = ",".join([os.environ.get(VARIABLE, ""), *prefixes]).strip(",")


def check_folders(folders: Iterable[str | None]) -> None:
    """Check the YAML files of folders that a command line adds to the configuration.

    Hydra calls the functions that such files name as launcher, sweeper, callback or handler of a log.

    Parameters
    ----------
    folders : iterable of str or None
        Values of ``--config-dir`` and of the setting ``hydra.searchpath``.

    Raises
    ------
    InputError
        On a function that is not allowed, a file that is not YAML, or a setting of Hydra that names code.
    """
    for folder in filter(None, folders):
        for path in sorted(Path(folder.removeprefix("file://")).rglob("*.yaml")):
            _check_file(path)


def _check_file(path: Path) -> None:
    import yaml

    try:
        text = path.read_text(encoding="utf-8")
        documents = list(yaml.safe_load_all(text))
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{path}: not readable as YAML ({' '.join(str(error).split())[:200]})") from error
    # Hydra adds a package to the key; the package stands in the header, or after an @ in a list of defaults.
    words = re.findall(r"# *@package +(\S+)", text)
    words += [str(word) for pair in _items(documents) for word in pair]
    for name in _RESERVED:
        if any(name in re.split(r"[.@/:]", word) for word in words):
            raise InputError(f"{path}: it sets hydra's {name}, which is for the command line alone")
    require_allowed(documents, where=str(path))


def _items(config: Any) -> Iterator[tuple[Any, Any]]:
    """Yield each key with its value, and None with each element of a list, at any depth."""
    if isinstance(config, Mapping):
        for key, value in config.items():
            yield key, value
            yield from _items(value)
    elif isinstance(config, (list, tuple)):
        for value in config:
            yield None, value
            yield from _items(value)

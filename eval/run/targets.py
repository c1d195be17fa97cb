"""Functions named in a configuration: ``_target_``, ``_partial_`` and parameters.

The format is the format of Hydra's ``instantiate``, with three more keys: ``warm_up`` has the parameters of
an untimed first run, ``note`` is a sentence below a table, and ``version`` is the number of the method's
version. In contrast to Hydra, :func:`instantiate` checks the names and simple types of parameters. An unknown
name is a mistake, but a library that is not installed skips the method. The module needs no Hydra, so figures
can load the task of a row.
"""

from __future__ import annotations

import importlib
import inspect
import os
import sys
import types
import typing
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from eval import PACKAGES
from sshade.core.errors import InputError, meant
from sshade.problem.options import checked

#: Packages of the project's methods. All other methods run in processes of their own.
OURS = ("sshade", "baselines")
#: Keys of a method's configuration that are not parameters of its function.
OWN_KEYS = ("_target_", "_partial_", "warm_up", "note", "version")


def instantiate(config: Mapping[str, Any]) -> Any:
    """Call the function of a configuration, or bind its parameters if ``_partial_`` is true.

    Parameters
    ----------
    config : mapping
        Plain values; a nested mapping with ``_target_`` is instantiated first.

    Raises
    ------
    InputError
        When the function does not exist or does not take the parameters.
    ImportError
        When a library that the function's module imports is not installed.
    """
    if "_target_" not in config:
        names = [name for name in config if name not in OWN_KEYS]
        raise InputError(f"the configuration with {', '.join(names) or 'no parameters'} names no _target_")
    function = locate(config["_target_"])
    parameters = {
        name: instantiate(value) if isinstance(value, Mapping) and "_target_" in value else value
        for name, value in config.items()
        if name not in OWN_KEYS
    }
    check_parameters(function, parameters, target=config["_target_"])
    return partial(function, **parameters) if config.get("_partial_") else function(**parameters)


def locate(target: str) -> Callable[..., Any]:
    """Return the function with a dotted name; also searches the current folder."""
    module_name, _, name = _dotted(target).rpartition(".")
    search_here()
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        missing = error.name or ""
        if module_name == missing or module_name.startswith(f"{missing}."):
            raise InputError(f"_target_ {target!r}: there is no module {missing!r}") from error
        raise
    function = getattr(module, name, None)
    if not callable(function):
        raise InputError(f"_target_ {target!r}: module {module_name!r} has no function {name!r}")
    return function


def _dotted(target: Any) -> str:
    """Return the dotted name of a function; raise InputError if it is anything else."""
    if not isinstance(target, str) or not target.rpartition(".")[0]:
        raise InputError(f"_target_ {target!r} is no function; write package.module.function")
    return target


def search_here() -> None:
    """Add the current folder to the end of Python's search path.

    The end, because a folder `eval` or `tests` of the user must not hide the project's packages.
    """
    sys.path.extend(folder for folder in (str(PACKAGES), os.getcwd()) if folder not in sys.path)


def is_ours(config: Mapping[str, Any]) -> bool:
    """Whether all functions that a method's configuration names are the project's."""
    parts = [value for value in config.values() if isinstance(value, Mapping)]
    return str(config.get("_target_", OURS[0])).split(".")[0] in OURS and all(map(is_ours, parts))


def require_kind(method: Callable[..., Any], kind: type, *, target: str) -> None:
    """Raise InputError if the type hint of a method's parameter `task` excludes a kind of tasks."""
    wanted = parameter_hints(method.func if isinstance(method, partial) else method).get("task", Any)
    if wanted is not Any and isinstance(wanted, type) and not issubclass(kind, wanted):
        raise InputError(
            f"{target} takes a {wanted.__name__}, but the case is a {kind.__name__}; methods for pose "
            "transfers are method=transfer/..., for tasks that a dataset with an edit gives"
        )


def settings(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the part of a configuration that can change the result: ``_target_`` and parameters."""
    return {
        name: settings(value) if isinstance(value, Mapping) else value
        for name, value in config.items()
        if name == "_target_" or name not in OWN_KEYS
    }


def flat(config: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    """Return nested settings as columns ``prefix.name``; lists become text."""
    columns: dict[str, Any] = {}
    for name, value in config.items():
        label = f"{prefix}.{'target' if name == '_target_' else name}"
        if isinstance(value, Mapping):
            columns.update(flat(value, label))
        else:
            columns[label] = str(value) if isinstance(value, (list, tuple)) else value
    return columns


def check_parameters(function: Callable[..., Any], parameters: Mapping[str, Any], *, target: str) -> None:
    """Raise InputError on an unknown parameter or a value of the wrong simple type."""
    hints = parameter_hints(function)
    if (names := getattr(function, "option_names", None)) is not None:
        named = _signature(function)
        options = {name: value for name, value in parameters.items() if name not in named}
        checked(options, names(parameters) if callable(names) else names, subject=target)
        parameters = {name: value for name, value in parameters.items() if name in named}
    takes_any = any(p.kind is p.VAR_KEYWORD and name in hints for name, p in _signature(function).items())
    unknown = [name for name in parameters if name not in hints and not takes_any]
    if unknown:
        hint = meant(unknown[0], hints) or f"; it has {', '.join(hints) or 'none'}"
        raise InputError(f"{target} has no parameter {unknown[0]!r}{hint}")
    for name, value in parameters.items():
        if name in hints and not _fits(value, hints[name]):
            wanted = inspect.formatannotation(hints[name])
            if typing.get_origin(hints[name]) is typing.Literal:
                wanted = f"one of {', '.join(map(repr, typing.get_args(hints[name])))}"
            raise InputError(f"{target}: {name}={value!r} does not fit; it takes {wanted}")


def parameter_hints(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the type hint of each parameter of a function, Any for a parameter without a hint.

    ``**options: Unpack[T]`` stands for the keys of the TypedDict T.
    """
    try:
        annotations = typing.get_type_hints(function)
    except NameError:  # the function imports the type of a hint for type checkers only
        annotations = {}
    hints: dict[str, Any] = {}
    for name in _signature(function):
        hint = annotations.get(name, Any)
        if typing.get_origin(hint) is typing.Unpack:
            hints |= typing.get_type_hints(*typing.get_args(hint))
        else:
            hints[name] = hint
    names = getattr(function, "option_names", ())
    if (kind := getattr(function, "task_kind", None)) is not None:
        hints["task"] = kind
    return hints | dict.fromkeys(names({}) if callable(names) else names, Any)


def _signature(function: Callable[..., Any]) -> Mapping[str, inspect.Parameter]:
    try:
        return inspect.signature(function).parameters
    except ValueError as error:  # as of some compiled functions
        raise InputError(
            f"{function.__name__} does not tell its parameters; name a Python function that calls it"
        ) from error


def _fits(value: Any, hint: Any) -> bool:
    """Whether a plain value satisfies a type hint; every value satisfies a hint that is no simple type."""
    origin = typing.get_origin(hint)
    if origin in (typing.Union, types.UnionType):
        return any(_fits(value, part) for part in typing.get_args(hint))
    if origin is typing.Literal:
        return value in typing.get_args(hint)
    if origin is Callable:
        return callable(value)
    if origin is list:
        return isinstance(value, (list, tuple))
    if hint in (bool, str, types.NoneType):
        return isinstance(value, hint)
    if hint in (int, float):
        return isinstance(value, (int, hint)) and not isinstance(value, bool)
    return True

"""Functions named in a configuration: ``_target_``, ``_partial_`` and parameters.

The convention of Hydra's ``instantiate``, with two keys more: ``warm_up``, and
``note``, a sentence for the foot of a table. This one checks names and simple
types of the parameters first, tells a name that does not exist (the
configuration is wrong) from a library that is not installed (the method is to be
skipped), and needs no Hydra, so that figures can load the task of a row.
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

from sshade.cli.configuration import PACKAGES
from sshade.errors import InputError
from sshade.options import checked

#: Keys of a method's configuration that are not for its function.
OWN_KEYS = ("_target_", "_partial_", "warm_up", "note")


def instantiate(config: Mapping[str, Any]) -> Any:
    """Call the function of a configuration, or bind its parameters if ``_partial_`` is true.

    Parameters
    ----------
    config : mapping
        Plain values; a value that is itself a mapping with ``_target_`` is instantiated first.

    Raises
    ------
    InputError
        When the function does not exist or does not take the parameters.
    ImportError
        When a library that the function's module imports is not installed.
    """
    if "_target_" not in config:
        given = [name for name in config if name not in OWN_KEYS]
        raise InputError(f"the configuration with {', '.join(given) or 'no parameters'} names no _target_")
    function = locate(config["_target_"])
    parameters = {
        name: instantiate(value) if isinstance(value, Mapping) and "_target_" in value else value
        for name, value in config.items()
        if name not in OWN_KEYS
    }
    check_parameters(function, parameters, target=config["_target_"])
    return partial(function, **parameters) if config.get("_partial_") else function(**parameters)


def locate(target: str) -> Callable[..., Any]:
    """The function of a dotted name such as "baselines.arap.arap", of a module in the current folder too."""
    module_name, name = _split(target)
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


def search_here() -> None:
    """Let modules of the current folder be found.

    Last of all: a folder `eval` or `tests` beside a module of one's own must not hide ours.
    """
    sys.path.extend(folder for folder in (str(PACKAGES), os.getcwd()) if folder not in sys.path)


def require_kind(method: Callable[..., Any], task: Any, *, target: str) -> None:
    """Raise InputError where a method says by its hint of `task` that it takes tasks of another kind."""
    wanted = parameter_hints(method.func if isinstance(method, partial) else method).get("task", Any)
    if wanted is not Any and isinstance(wanted, type) and not isinstance(task, wanted):
        raise InputError(
            f"{target} takes a {wanted.__name__}, but {task.name} is a {type(task).__name__}; methods for "
            "pose transfers are method=transfer/..., for tasks that a dataset with an edit gives"
        )


def target_functions(config: Mapping[str, Any]) -> set[str]:
    """Return the dotted names of all functions in a configuration, nested ones included."""
    names = {config["_target_"]} if "_target_" in config else set()
    for value in config.values():
        if isinstance(value, Mapping):
            names |= target_functions(value)
    return names


def settings(config: Mapping[str, Any]) -> dict[str, Any]:
    """A configuration without what does not change the result (all own keys but ``_target_``), nested too."""
    return {
        name: settings(value) if isinstance(value, Mapping) else value
        for name, value in config.items()
        if name == "_target_" or name not in OWN_KEYS
    }


def flat(config: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    """Nested settings as ``prefix.name`` columns; lists become text."""
    columns: dict[str, Any] = {}
    for name, value in config.items():
        label = f"{prefix}.{'target' if name == '_target_' else name}"
        if isinstance(value, Mapping):
            columns.update(flat(value, label))
        else:
            columns[label] = str(value) if isinstance(value, (list, tuple)) else value
    return columns


def _split(target: str) -> tuple[str, str]:
    module, _, name = target.rpartition(".")
    if not module:
        raise InputError(f"_target_ {target!r} is no function; write package.module.function")
    return module, name


def check_parameters(function: Callable[..., Any], parameters: Mapping[str, Any], *, target: str) -> None:
    """Raise InputError on a parameter that the function does not have, or a value of another simple type."""
    hints = parameter_hints(function)
    if (names := getattr(function, "option_names", None)) is not None:
        named = _signature(function)
        options = {name: value for name, value in parameters.items() if name not in named}
        checked(options, names(parameters) if callable(names) else names, subject=target)
        parameters = {name: value for name, value in parameters.items() if name in named}
    takes_any = any(p.kind is p.VAR_KEYWORD and name in hints for name, p in _signature(function).items())
    unknown = [name for name in parameters if name not in hints and not takes_any]
    if unknown:
        raise InputError(
            f"{target} has no parameter {unknown[0]!r}; it has {', '.join(hints) or 'no parameters'}"
        )
    for name, value in parameters.items():
        if name in hints and not _fits(value, hints[name]):
            wanted = inspect.formatannotation(hints[name])
            if typing.get_origin(hints[name]) is typing.Literal:
                wanted = f"one of {', '.join(map(repr, typing.get_args(hints[name])))}"
            raise InputError(f"{target}: {name}={value!r} does not fit; it takes {wanted}")


def parameter_hints(function: Callable[..., Any]) -> dict[str, Any]:
    """The parameters of a function and their type hints, Any where there is none to be had.

    ``**options: Unpack[T]`` stands for the keys of the TypedDict T.
    """
    try:
        given = typing.get_type_hints(function)
    except NameError:  # a hint that is imported for type checkers only
        given = {}
    hints: dict[str, Any] = {}
    for name in _signature(function):
        hint = given.get(name, Any)
        if typing.get_origin(hint) is typing.Unpack:
            hints |= typing.get_type_hints(*typing.get_args(hint))
        else:
            hints[name] = hint
    names = getattr(function, "option_names", ())
    return hints | dict.fromkeys(() if callable(names) else names, Any)


def _signature(function: Callable[..., Any]) -> Mapping[str, inspect.Parameter]:
    return inspect.signature(function).parameters


def _fits(value: Any, hint: Any) -> bool:
    """Whether a plain value satisfies a hint; hints other than simple types are not judged."""
    origin = typing.get_origin(hint)
    if origin in (typing.Union, types.UnionType):
        return any(_fits(value, part) for part in typing.get_args(hint))
    if origin is typing.Literal:
        return value in typing.get_args(hint)
    if origin is Callable:
        return callable(value)
    if hint in (bool, str, types.NoneType):
        return isinstance(value, hint)
    if hint in (int, float):
        return isinstance(value, (int, hint)) and not isinstance(value, bool)
    return True

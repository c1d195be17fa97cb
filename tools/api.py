"""List the public interface, and compare the list with ``api.txt``: ``python -m tools.api``.

The list has the names, signatures, fields and methods of the package ``sshade``, the options of each method
with their defaults, and the arguments and settings of the three commands. If a line changes, code or scripts
of users may fail. The command prints changed lines and then exits with code 1. With ``--update``, it writes
the list anew.
"""

from __future__ import annotations

import argparse
import inspect
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from difflib import unified_diff
from pathlib import Path
from typing import Any

import yaml

import sshade
from defaust.cli import make_parser
from eval.main import PROGRAM as EVAL
from sshade.cli.configuration import CONFIGURATION
from sshade.cli.main import PROGRAM as SSHADE
from sshade.options import OLD_METHODS, OLD_NAMES, PRESETS, REGIONS, accepted, described

#: The public interface, one fact a line.
LIST = Path(__file__).parent / "api.txt"
#: Special methods that users call.
SPECIAL = ("__call__", "__enter__", "__exit__", "__getitem__", "__iter__", "__len__")
#: Files of ``conf`` that declare the settings of Hydra programs, by command and prefix of the settings.
SETTINGS = {
    "sshade-eval run ": "config.yaml",
    "sshade-eval run run.": "run/default.yaml",
    "defaust build ": "defaust/build.yaml",
}
#: Sources of ``defaust build``.
SOURCES = sorted((CONFIGURATION / "defaust" / "source").glob("*.yaml"))


def main() -> int:
    """Run the command; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.api", description=__doc__)
    parser.add_argument("--update", action="store_true", help="write the list from the code")
    update = parser.parse_args().update
    changes = changed_lines()
    print("\n".join(changes) or f"{LIST.name} agrees with the code")
    if update:
        LIST.write_text("".join(f"{line}\n" for line in listed()), "utf-8")
    return int(bool(changes) and not update)


def changed_lines() -> list[str]:
    """Return the lines that differ: lines of the list with ``-``, lines of the code with ``+``."""
    old = LIST.read_text("utf-8").splitlines() if LIST.exists() else []
    lines = unified_diff(old, list(listed()), n=0, lineterm="")
    return [line for line in lines if not line.startswith(("---", "+++", "@@"))]


def listed() -> Iterator[str]:
    """Yield the lines of the list."""
    for name in sshade.__all__:
        value = getattr(sshade, name)
        yield from (of_class if isinstance(value, type) else of_callable)(f"sshade.{name}", value)
    yield from of_options()
    for program in (SSHADE, EVAL):
        yield from of_parser(program.name, program.parser())
    yield from of_parser("defaust", make_parser())
    for prefix, file in SETTINGS.items():
        yield from of_settings(prefix, yaml.safe_load((CONFIGURATION / file).read_text("utf-8")))
    for path in SOURCES:
        text = path.read_text("utf-8")
        prefix = f"defaust build source={path.stem} "
        yield prefix.strip()
        yield from of_settings(
            prefix if "@package _global_" in text else f"{prefix}source.", yaml.safe_load(text)
        )


def of_class(name: str, kind: type) -> Iterator[str]:
    """Yield the bases, the parameters, the fields and the public members of a class."""
    yield f"{name}: {', '.join(base.__name__ for base in kind.__bases__ if base is not object) or 'class'}"
    if ("__init__" in vars(kind) or issubclass(kind, tuple)) and not getattr(kind, "_is_protocol", False):
        yield from _parameters(name, kind)
    own = [entry.name for entry in fields(kind)] if is_dataclass(kind) else getattr(kind, "_fields", ())
    for field in own:
        yield f"{name}.{field}"
    members: dict[str, Any] = {}
    for base in reversed(kind.__mro__):
        members |= vars(base) if base.__module__.startswith("sshade.") else {}
    for member, value in members.items():
        if member in own or (member.startswith("_") and member not in SPECIAL):
            continue
        if isinstance(value, staticmethod | classmethod) or callable(value):
            yield from of_callable(f"{name}.{member}", getattr(kind, member))
        else:
            yield f"{name}.{member}"


def of_callable(name: str, function: Any) -> Iterator[str]:
    """Yield a line for each parameter, in order, and a line for the type that is returned."""
    yield from _parameters(name, function)
    yield f"{name}() -> {_annotation(inspect.signature(function).return_annotation)}"


def _parameters(name: str, function: Any) -> Iterator[str]:
    for parameter in inspect.signature(function).parameters.values():
        if parameter.name != "self":
            yield f"{name}({_parameter(parameter)})"


def _parameter(parameter: inspect.Parameter) -> str:
    kinds = {parameter.VAR_POSITIONAL: "*", parameter.VAR_KEYWORD: "**", parameter.KEYWORD_ONLY: "*, "}
    text = f"{kinds.get(parameter.kind, '')}{parameter.name}: {_annotation(parameter.annotation)}"
    if parameter.default is not parameter.empty:
        text += f" = {_value(parameter.default)}"
    return f"{text}, /" if parameter.kind is parameter.POSITIONAL_ONLY else text


def _annotation(annotation: Any) -> str:
    if annotation is inspect.Signature.empty:
        return "none given"
    return str(getattr(annotation, "__forward_arg__", annotation))


def _value(value: Any) -> str:
    """Return a default as text. The text of a function has no address, and is the same in every process."""
    return value.__name__ if callable(value) else str(value) if isinstance(value, Path) else repr(value)


def of_options() -> Iterator[str]:
    """Yield the valid values of each option, each method's options with defaults, and old names."""
    for name, option in described().items():
        if option.methods:
            yield f"option {name}: {option.values}"
    for method, options in PRESETS.items():
        for name, value in options.subset(accepted(method)).items():
            regional = REGIONS.get(method, {})
            text = f", with handle regions {regional[name]}" if name in regional else ""
            yield f"method {method}: {name} = {value}{text}"
    for old, new in (OLD_NAMES | OLD_METHODS).items():
        yield f"old name {old}: {new}"


def of_parser(name: str, parser: argparse.ArgumentParser) -> Iterator[str]:
    """Yield the arguments of a command and of its sub-commands."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command, sub_parser in action.choices.items():
                yield f"{name} {command}"
                yield from of_parser(f"{name} {command}", sub_parser)
        elif action.help != argparse.SUPPRESS and not isinstance(action, argparse._HelpAction):
            yield f"{name} {_argument(action)}"


def _argument(action: argparse.Action) -> str:
    text = " ".join(action.option_strings) or str(action.metavar or action.dest)
    if action.choices:
        text += f" {{{','.join(map(str, action.choices))}}}"
    elif action.option_strings and action.nargs != 0:
        text += " VALUE"
    if action.nargs:
        text += f", number {action.nargs}"
    if action.option_strings and action.required:
        text += ", required"
    return (
        text if action.default in (None, False, argparse.SUPPRESS) else f"{text} = {_value(action.default)}"
    )


def of_settings(prefix: str, settings: dict[str, Any]) -> Iterator[str]:
    """Yield the settings of a file of ``conf`` with their defaults."""
    for key, value in settings.items():
        if key in ("defaults", "hydra", "_target_"):
            continue
        if isinstance(value, dict) and prefix.endswith(
            "source."
        ):  # data, such as the vertex of each landmark
            yield f"{prefix}{key}"
        elif isinstance(value, dict):
            yield from of_settings(f"{prefix}{key}.", value)
        else:
            yield f"{prefix}{key}={value}"


if __name__ == "__main__":
    sys.exit(main())

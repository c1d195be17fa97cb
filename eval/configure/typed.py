"""Programs, functions and folders that a command line names."""

from __future__ import annotations

from collections.abc import Iterable

from hydra.core.override_parser.overrides_parser import OverridesParser

from sshade.core.errors import InputError
from sshade.programs import ALLOWING, allow


def allow_programs(settings: Iterable[str]) -> None:
    """Allow the commands in the settings ``run.allow_programs=[...]`` and ``method.command=[...]``.

    A sweep over several commands allows each. An interpolation is no name, so the command that it stands for
    is not allowed.

    Parameters
    ----------
    settings : iterable of str
        Words ``key=value`` that the user typed.

    Raises
    ------
    InputError
        When the value of ``run.allow_programs`` is not a list of texts.
    """
    parser = OverridesParser.create()
    for text in settings:
        key = _key(text)
        if key == ALLOWING:
            (override,) = parser.parse_overrides([text])
            commands = override.value()
            if not isinstance(commands, list) or not all(isinstance(line, str) for line in commands):
                raise InputError(
                    f"{text} is not a list of commands; write \"{ALLOWING}=['python3 mymethod.py']\""
                )
            allow(commands)
        elif key.startswith("method.") and key.endswith(".command"):
            (override,) = parser.parse_overrides([text])
            swept = override.is_sweep_override()
            texts = override.sweep_string_iterator() if swept else [override.get_value_element_as_str()]
            values = [one.value() for one in parser.parse_overrides([f"one={value}" for value in texts])]
            allow(value for value in values if isinstance(value, list))


def listed(settings: Iterable[str], key: str) -> list[str]:
    """Return the elements of the lists in the words ``key=[a, b]``; ``key=a`` counts as a list of one."""
    given = [text for text in settings if _key(text) == key]
    texts: list[str] = []
    for override in OverridesParser.create().parse_overrides(given):
        value = override.value()
        texts += map(str, value if isinstance(value, list) else [value])
    return texts


def _key(text: str) -> str:
    return text.lstrip("+").partition("=")[0]

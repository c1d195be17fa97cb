"""Programs of other people: how a configuration names one, and which ones may run.

A configuration or a row may come from a stranger, and a program can do anything. A program
therefore runs only if the user has named its whole command: as ``method.command=[...]`` or in
``run.allow_programs=[...]`` on the command line of ``sshade-eval``, or in the environment variable
``EVAL_ALLOW_PROGRAMS``, one command a line. The name of an interpreter alone allows no script.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable
from typing import Any

from sshade.core.errors import InputError

#: Variable with the allowed commands, one a line. Workers of a launcher inherit it.
ALLOWED = "EVAL_ALLOW_PROGRAMS"
#: Setting with the same meaning on a command line; a YAML file cannot set it.
ALLOWING = "run.allow_programs"
#: Variable with the time limit of a run in seconds; missing in a run without a limit.
TIME_LIMIT = "EVAL_TIME_LIMIT"

#: Words of a command that stand for files, which must be among the arguments of the program.
FILES = ("{mesh}", "{handles}", "{output}")
#: All words that stand for a value of the run.
PLACEHOLDERS = (*FILES, "{seed}", "{time_limit}")


def words_of(command: Any) -> list[str]:
    """Return the words of a command; the placeholders of the files are appended where all are missing.

    Raises
    ------
    InputError
        When `command` is not a list of texts and numbers, or has some of the files only.
    """
    if not isinstance(command, (list, tuple)) or not command or not all(map(_is_word, command)):
        raise InputError(
            f"command={command!r} is not a list of words; write method.command=[python3,mymethod.py], with "
            'placeholders in quotes: "{mesh}"'
        )
    words = [str(word) for word in command]
    missing = [name for name in FILES if not any(name in word for word in words)]
    if not missing:
        return words
    if len(missing) < len(FILES):
        raise InputError(f"command={words} lacks {missing[0]}; name {', '.join(FILES)}, or none of them")
    return [*words, *FILES]


def require_permission(command: Any, *, where: str) -> None:
    """Raise InputError unless the user has allowed a command.

    Words that are placeholders do not count. All other words must be equal to the words of an allowed
    command, so neither another path to the same file nor a further argument is allowed.

    Parameters
    ----------
    command : list of str
    where : str
        Origin of the command, for the message.
    """
    asked = _named(words_of(command))
    allowed = [_named(shlex.split(line)) for line in os.environ.get(ALLOWED, "").splitlines()]
    if asked not in allowed:
        text = shlex.join(asked)
        inside = text.replace("'", '\\"')  # it stands in quotes of Hydra in quotes of the shell
        raise InputError(
            f"{where} runs the program `{text}`, which is not allowed; if you trust it, give "
            f"\"{ALLOWING}=['{inside}']\" on the command line, or set {ALLOWED}"
        )


def allow(commands: Iterable[Any]) -> None:
    """Allow commands, each a text or a list of words, in this process and its child processes."""
    texts = [line if isinstance(line, str) else shlex.join(words_of(line)) for line in commands]
    os.environ[ALLOWED] = "\n".join([*os.environ.get(ALLOWED, "").splitlines(), *texts])


def _is_word(word: Any) -> bool:
    return isinstance(word, (str, int, float)) and not isinstance(word, bool) and "\0" not in str(word)


def _named(words: list[str]) -> list[str]:
    """Return the words that are no placeholders."""
    return [word for word in words if word not in PLACEHOLDERS]

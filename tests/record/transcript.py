"""Transcripts: command lines and lines of Python, and what they say, give and write.

A transcript is a text file of ``tests/record/commands``. Its first lines say what it is about and which
function of :mod:`tests.record.inputs` writes the files. A line that begins with ``> `` has the name and the
content of a further file, with escapes as in Python's bytes. A line that begins with ``$ `` is a command; the
lines below it are recorded: what the command says, its exit code if it is not 0, and what each file holds
that is new or has changed. A line that begins with ``>>> `` is Python; its value, its warnings or its error
are recorded, and the files.
"""

import warnings
from collections.abc import Iterator
from pathlib import Path
from types import CodeType
from typing import Any

from tests.files import contents
from tests.record import inputs
from tests.record.described import described, file_lines, steady, text_lines
from tests.robustness.case import run

HERE = Path(__file__).parent / "commands"
INPUT, FILE, COMMAND, PYTHON = "Files: ", "> ", "$ ", ">>> "


def transcripts() -> list[str]:
    """Return the names of all transcripts."""
    return sorted(path.stem for path in HERE.glob("*.txt"))


def recorded(name: str) -> list[str]:
    """Return the lines of a transcript."""
    return (HERE / f"{name}.txt").read_text("utf-8").splitlines()


def played(lines: list[str]) -> list[str]:
    """Run the lines of a transcript in an empty working folder; return the transcript of this run."""
    begins, known = (FILE, COMMAND, PYTHON), dict[str, Any]()
    head = lines[: next((i for i, line in enumerate(lines) if line.startswith(begins)), None)]
    made = [line for line in head if line]
    for line in lines:
        if line.startswith(INPUT):
            getattr(inputs, line.removeprefix(INPUT))()
        elif line.startswith(begins):
            begin = next(begin for begin in begins if line.startswith(begin))
            if not made[-1].startswith((FILE, PYTHON)):
                made.append("")
            made.append(line)
            made += _effects(begin, line.removeprefix(begin), known)
    return made


def _effects(begin: str, text: str, known: dict[str, Any]) -> list[str]:
    if begin == FILE:
        name, _, content = text.partition(" ")
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_bytes(content.encode("latin-1").decode("unicode_escape").encode("latin-1"))
        return []
    before = contents()
    lines = list(_said(text) if begin == COMMAND else _given(text, known))
    after = contents()
    for name in sorted(before.keys() | after.keys()):
        if name not in after:
            lines.append(f"{name} is removed")
        elif before.get(name) != after[name] and not name.endswith("multirun.yaml"):
            lines += [f"{steady(name)}: {line}" for line in file_lines(Path(name))]
    return [line.rstrip() for line in lines]


def _said(command: str) -> Iterator[str]:
    code, out, err = run(command)
    if code:
        yield f"exit code {code}"
    yield from (f"out: {line}" for line in text_lines(out))
    yield from (f"err: {line}" for line in text_lines(err))


def _given(text: str, known: dict[str, Any]) -> Iterator[str]:
    """Yield the value of an expression, or what a statement warns of; names are kept in `known`."""
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            value = eval(_compiled(text), known)
        except Exception as error:
            yield steady(f"{type(error).__name__}: {error}")
        else:
            yield from described(value, "value") if value is not None else ()
    yield from (steady(f"warning: {warning.message}") for warning in warned)


def _compiled(text: str) -> CodeType:
    try:
        return compile(text, "<line>", "eval")
    except SyntaxError:
        return compile(text, "<line>", "exec")

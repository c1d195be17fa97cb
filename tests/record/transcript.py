"""Transcripts: command lines and lines of Python, and what they say, give and write.

A transcript is a text file of ``tests/record/commands``. Its first lines say what it is about and which
function of :mod:`tests.record.inputs` writes the files. A line that begins with ``> `` has the name and the
content of a further file, with escapes as in Python's bytes. A line that begins with ``$ `` is a command; the
lines below it are recorded: what the command says, its exit code if it is not 0, and what each file holds
that is new or has changed. A line that begins with ``>>> `` is Python, which goes on in lines that begin with
``... ``; its value, its warnings or its error are recorded, and the files. A line that begins with ``@ `` has
actions of a user on a page, which node plays; ``@ open`` opens the page of a session or of a file, the value
of Python. A line that begins with ``% `` is a command of which the functions that it calls more than once are
recorded: see :mod:`tests.record.work`.
"""

import re
import warnings
from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path
from types import CodeType
from typing import Any

from eval.pace import on_one_cpu
from tests.files import contents
from tests.record import inputs
from tests.record.described import described, file_lines, steady, text_lines
from tests.record.pages import Page
from tests.record.work import comparable, counted, counts
from tests.robustness.case import run

HERE = Path(__file__).parent / "commands"
INPUT, FILE, COMMAND, PYTHON, PAGE, WORK = "Files: ", "> ", "$ ", ">>> ", "@ ", "% "
FURTHER = "... "
OPEN = "open "
#: Names of recovery files, which vary, and files that are not recorded.
RECOVERY = re.compile(r"\.recovery-[0-9a-f]{6}\b")
UNTOLD = re.compile(r"\.recovery-\w+\.npz$|multirun\.yaml$")


def transcripts() -> list[str]:
    """Return the names of all transcripts."""
    return sorted(path.stem for path in HERE.glob("*.txt"))


def recorded(name: str) -> list[str]:
    """Return the lines of a transcript."""
    return comparable((HERE / f"{name}.txt").read_text("utf-8").splitlines())


def played(lines: list[str]) -> list[str]:
    """Run the lines of a transcript in an empty working folder; return the transcript of this run."""
    begins = FILE, COMMAND, PYTHON, PAGE, WORK
    head = lines[: next((i for i, line in enumerate(lines) if line.startswith(begins)), None)]
    made = [line for line in head if line]
    with Page() as page:
        known: dict[str, Any] = {"page": page}
        for i, line in enumerate(lines):
            if line.startswith(INPUT):
                getattr(inputs, line.removeprefix(INPUT))()
            elif line.startswith(begins):
                begin = next(begin for begin in begins if line.startswith(begin))
                if not made[-1].startswith((FILE, PYTHON, FURTHER)):
                    made.append("")
                whole = [line, *takewhile(lambda line: line.startswith(FURTHER), lines[i + 1 :])]
                made += whole
                text = "\n".join(part.removeprefix(begin).removeprefix(FURTHER) for part in whole)
                made += _effects(begin, text, known)
    return made


def _effects(begin: str, text: str, known: dict[str, Any]) -> list[str]:
    if begin == FILE:
        name, _, content = text.partition(" ")
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_bytes(content.encode("latin-1").decode("unicode_escape").encode("latin-1"))
        return []
    if begin == WORK:
        return _worked(text)
    before = contents()
    effects = {COMMAND: _said, PYTHON: _given, PAGE: _played}
    lines = list(effects[begin](text, known))
    after = contents()
    for name in sorted(before.keys() | after.keys()):
        if UNTOLD.search(name):
            continue
        if name not in after:
            lines.append(f"{name} is removed")
        elif before.get(name) != after[name]:
            lines += [f"{steady(name)}: {line}" for line in file_lines(Path(name))]
    return [line.rstrip() for line in lines]


def _worked(command: str) -> list[str]:
    """Return the functions that a command calls more than once."""
    with on_one_cpu(), counted() as calls:
        code, _, err = run(command)
    assert not code, err
    return [line for line in counts(calls) if not line.startswith("1 ")]


def _said(command: str, _: dict[str, Any]) -> Iterator[str]:
    code, out, err = run(command)
    if code:
        yield f"exit code {code}"
    yield from (f"out: {line}" for line in text_lines(out))
    yield from (f"err: {line}" for line in text_lines(err))


def _played(text: str, known: dict[str, Any]) -> Iterator[str]:
    page = known["page"]
    opens = text.startswith(OPEN)
    lines = page.show(*eval(f"[{text.removeprefix(OPEN)}]", known)) if opens else page.play(text)
    yield from (RECOVERY.sub(".recovery-<hash>", line) for line in lines)


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

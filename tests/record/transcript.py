"""Transcripts: command lines, and what they say and write.

A transcript is a text file of ``tests/record/commands``. Its first lines say what it is about and which
function of :mod:`tests.record.inputs` writes the files. A line that begins with ``$ `` is a command; the
lines below it are recorded: what the command says, its exit code if it is not 0, and what each file holds
that is new or has changed.
"""

from pathlib import Path

from tests.files import contents
from tests.record import inputs
from tests.record.described import file_lines, steady, text_lines
from tests.robustness.case import run

HERE = Path(__file__).parent / "commands"
INPUT, COMMAND = "Files: ", "$ "


def transcripts() -> list[str]:
    """Return the names of all transcripts."""
    return sorted(path.stem for path in HERE.glob("*.txt"))


def recorded(name: str) -> list[str]:
    """Return the lines of a transcript."""
    return (HERE / f"{name}.txt").read_text("utf-8").splitlines()


def played(lines: list[str]) -> list[str]:
    """Run the commands of a transcript in an empty working folder; return the transcript of this run."""
    head = lines[: next((i for i, line in enumerate(lines) if line.startswith(COMMAND)), None)]
    made = [line for line in head if line]
    for line in lines:
        if line.startswith(INPUT):
            getattr(inputs, line.removeprefix(INPUT))()
        if line.startswith(COMMAND):
            made += ["", line, *_said_and_written(line.removeprefix(COMMAND))]
    return made


def _said_and_written(command: str) -> list[str]:
    before = contents()
    code, out, err = run(command)
    lines = [f"exit code {code}"] if code else []
    lines += [f"out: {line}" for line in text_lines(out)]
    lines += [f"err: {line}" for line in text_lines(err)]
    after = contents()
    for name in sorted(before.keys() | after.keys()):
        if name not in after:
            lines.append(f"{name} is removed")
        elif before.get(name) != after[name] and not name.endswith("multirun.yaml"):
            lines += [f"{steady(name)}: {line}" for line in file_lines(Path(name))]
    return [line.rstrip() for line in lines]

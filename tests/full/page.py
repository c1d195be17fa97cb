"""The page that tells what was tried: results/robustness.md."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from sshade.io.files import replacing
from tests.full.record import ROOT, Record
from tests.full.steps import Step

PAGE = ROOT / "results" / "robustness.md"

HEAD = """# Robustness: what was tried, and what came of it

Made by `make robustness` from records of real runs, one for each line. A commit with a `+` had changes
of its own beside it.

| what | what came of it | time | date (UTC) | commit |
| --- | --- | ---: | --- | --- |
"""


def write_page(done: Mapping[str, tuple[Step, Record]], path: Path = PAGE) -> list[str]:
    """Write the page; a sentence for each step that is not done or failed.

    Parameters
    ----------
    done : mapping
        Each step and its record, by the step's name.
    path : Path
    """
    problems = [problem for name, (_, record) in done.items() if (problem := _problem(name, record))]
    lines = [_line(step, record) for step, record in done.values()]
    records = [record for _, record in done.values() if record.date]
    parts = [HEAD + "\n".join(lines), *_coverage(done), _where(records)]
    with replacing(path) as temporary:
        temporary.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    return problems


def _problem(name: str, record: Record) -> str:
    if record.figures.get("failures"):
        return f"{name} failed: {record.figures['failures'][0]}"
    return "" if record.complete else f"{name} is not done"


def _line(step: Step, record: Record) -> str:
    if record.figures.get("failures"):
        outcome = "**failed**"
    else:
        try:
            outcome = ("" if record.complete else "not done yet: ") + told(step, record)
        except KeyError:  # some of its figures come last
            outcome = "not done"
    cells = (step.about, outcome, _duration(record.seconds), record.date, ", ".join(record.commits))
    return f"| {' | '.join(cells)} |"


def told(step: Step, record: Record) -> str:
    """What came of a step that passed, with commas in large numbers."""
    figures = record.figures.items()
    return step.told.format(**{n: f"{v:,}" if type(v) is int else v for n, v in figures})


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"


def _coverage(done: Mapping[str, tuple[Step, Record]]) -> Sequence[str]:
    """Lines run, by package."""
    figures = done["coverage"][1].figures
    if "shares" not in figures:
        return []
    table = ["| package | lines run |", "| --- | ---: |"]
    table += [f"| {name} | {share:.1f} % |" for name, share in figures["shares"].items()]
    low = ", ".join(f"{name} ({share:.0f} %)" for name, share in figures["low"].items())
    return ["\n".join(table), f"Modules with less than 85 %: {low or 'none'}."]


def _where(records: Sequence[Record]) -> str:
    """Machines and versions, each once."""
    machines = sorted({record.machine for record in records})
    versions = sorted({f"{n} {v}" for record in records for n, v in record.versions.items()})
    pythons = sorted({f"Python {record.python}" for record in records})
    return f"On {'; '.join(machines)}. {', '.join([*pythons, *versions])}."

"""What a step found: a JSON file each, kept after each part, so that an interruption loses one part."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter
from typing import Any

from eval.run.provenance import environment, version_of
from sshade.io.files import make_folder, replacing

ROOT = Path(__file__).parents[2]
#: Not committed; the page made of it is.
FOLDER = ROOT / "results" / "runs" / "robustness"
#: What a figure may depend on.
LIBRARIES = ("numpy", "scipy", "numba", "libigl", "hypothesis", "atheris", "coverage")

Figures = dict[str, Any]


@dataclass
class Record:
    """One step.

    Parameters
    ----------
    step : str
    figures : dict
        Numbers and names; ``failures`` is a list of sentences.
    complete : bool
        Whether its last part was done.
    seconds : float
        Of all its parts.
    commits : list of str
        Of the parts, without repetitions; ``+`` marks a tree with changes of its own.
    date, machine, python : str
        Of the last part.
    versions : dict
        Library -> version.
    """

    step: str
    figures: Figures = field(default_factory=dict)
    complete: bool = False
    seconds: float = 0.0
    commits: list[str] = field(default_factory=list)
    date: str = ""
    machine: str = ""
    python: str = ""
    versions: dict[str, str] = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        """Whether all of it was done and nothing failed."""
        return self.complete and not self.figures.get("failures")

    def save(self, folder: Path) -> None:
        """Write it, whole or not at all."""
        make_folder(folder)
        with replacing(folder / f"{self.step}.json") as path:
            path.write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")


def load(step: str, folder: Path) -> Record:
    """The record of a step, an empty one where it has not begun."""
    path = folder / f"{step}.json"
    return Record(**json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else Record(step)


def fill(record: Record, parts: Iterator[Figures], folder: Path) -> None:
    """Go through the parts of a step and save what each adds up to."""
    begin = perf_counter()
    for figures in parts:
        record.figures = figures
        _sign(record)
        record.seconds += perf_counter() - begin
        begin = perf_counter()
        record.save(folder)
        if figures.get("failures"):
            return
    record.complete = True
    record.save(folder)


def _sign(record: Record) -> None:
    """Add when, where and of what the last part was."""
    facts = environment(jobs=1)
    commit = facts["commit"][:7] + ("+" if facts["modified"] else "")
    if commit not in record.commits:
        record.commits.append(commit)
    record.date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M")
    record.machine, record.python = facts["machine"], facts["python"]
    record.versions = {name: version_of(name) for name in LIBRARIES}

"""Steps of whole programs: property tests on more examples, kernels uncompiled, coverage by lines."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from tests.full.record import FOLDER, ROOT, Figures
from tests.robustness import uncompiled

PACKAGES = ("sshade", "baselines", "defaust", "eval")
#: Parts of the test suite; what they leave is kept between them.
FOLDERS = ("sshade", "fuzz", "full", "faults", "contract", "defaust", "eval", "robustness", "baselines")
DATA = FOLDER / "coverage"
#: Lines of each package that must be run, in percent; modules with less than this of theirs are named.
ENOUGH, LITTLE = 90.0, 85.0


def properties(figures: Figures, *, examples: int) -> Iterator[Figures]:
    """The invariances of the whole method, with more examples than the test suite has."""
    summary, failures = _pytest(["tests/sshade/test_invariances.py"], INVARIANCE_EXAMPLES=str(examples))
    yield {"examples": examples, "properties": summary.get("passed", 0), "failures": failures}


def kernels(figures: Figures) -> Iterator[Figures]:
    """Every kernel as plain Python."""
    found = uncompiled.compare()
    yield {
        "kernels": len(found.called),
        "pieces": len(found.apart),
        "apart": max(found.apart.values()),
        "failures": found.failures,
    }


def coverage(figures: Figures) -> Iterator[Figures]:
    """The test suite, a folder of it at a time: what lines it runs, of kernels those uncompiled."""
    DATA.mkdir(parents=True, exist_ok=True)
    done = figures.get("folders", [])
    if not done:
        for path in DATA.iterdir():
            path.unlink()
    place = {"COVERAGE_FILE": str(DATA / "data")}
    counts = {name: figures.get(name, 0) for name in ("tests", "skipped", "warnings")}
    for folder in [name for name in FOLDERS if name not in done]:
        prefix = [sys.executable, "-m", "coverage", "run", "-m", "pytest"]
        summary, failures = _pytest(
            [f"tests/{folder}", "-n", "2", "--dist", "loadfile"], prefix=prefix, **place
        )
        if failures:
            yield {**figures, "failures": failures}
            return
        for name, word in (("tests", "passed"), ("skipped", "skipped"), ("warnings", "warnings")):
            counts[name] += summary.get(word, 0)
        done = [*done, folder]
        figures = {**counts, "folders": done, "failures": []}
        yield figures
    yield {**figures, **_lines(place)}


def _lines(place: dict[str, str]) -> Figures:
    """Count what all folders left."""
    report, failures = DATA / "report.json", []
    for words in (["combine", "-q", "--keep"], ["json", "-q", "-o", str(report)]):
        done = _run([sys.executable, "-m", "coverage", *words], **place)
        if done.returncode:
            failures.append(f"coverage {words[0]}: {done.stderr[-500:]}")
    shares, low = by_package(json.loads(report.read_text())["files"]) if not failures else ({}, {})
    failures += [f"{name}: {share:.1f} % of lines" for name, share in shares.items() if share < ENOUGH]
    return {"shares": shares, "low": low, "least": min(shares.values(), default=0.0), "failures": failures}


def by_package(files: dict[str, dict]) -> tuple[dict[str, float], dict[str, float]]:
    """Percent of lines that were run: of each package, and of each module where that is little.

    Parameters
    ----------
    files : dict
        Of coverage's JSON report: path -> ``{"summary": {"covered_lines": .., "num_statements": ..}}``.
    """
    run, lines = defaultdict(int), defaultdict(int)
    low = {}
    for path, content in sorted(files.items()):
        summary = content["summary"]
        package = Path(path).parts[0]
        run[package] += summary["covered_lines"]
        lines[package] += summary["num_statements"]
        if summary["covered_lines"] < LITTLE / 100 * summary["num_statements"]:
            low[path] = 100 * summary["covered_lines"] / summary["num_statements"]
    return {name: 100 * run[name] / lines[name] for name in PACKAGES if lines[name]}, low


def _pytest(
    arguments: list[str], *, prefix: list[str] | None = None, **environment: str
) -> tuple[dict[str, int], list[str]]:
    """Counts of pytest's last line, and what failed."""
    done = _run([*(prefix or [sys.executable, "-m", "pytest"]), "-q", *arguments], **environment)
    counts = {
        word: int(count)
        for count, word in re.findall(
            r"(\d+) (passed|failed|errors?|skipped|warnings?)\b", done.stdout.splitlines()[-1]
        )
    }
    failures = re.findall(r"^((?:FAILED|ERROR) .*)$", done.stdout, re.MULTILINE)
    if done.returncode and not failures:
        failures = [f"pytest: exit code {done.returncode}: {done.stdout[-500:]} {done.stderr[-500:]}"]
    return counts, failures


def _run(command: list[str], **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, cwd=ROOT, env={**os.environ, **environment}, capture_output=True, text=True, errors="replace"
    )

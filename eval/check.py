"""Compare methods with golden values: ``sshade-eval check [METHOD ...]``.

Each method of ``conf/method`` runs on small tasks. Measures must agree with ``conf/golden.yaml``, which has
the tasks, the golden values and the tolerances. Then calls, drags and handle regions are timed against
libigl's Elastic. A method whose extra is not installed is left out. Exit code 1 if a method differs, is too
slow, sleeps, or fails.

If new results are intended, raise `version` in ``conf/method/NAME.yaml``, or `MEASURES` in ``eval/metrics``
where a measure changed. Then ``--write`` replaces the golden values; it refuses where values changed and
neither version rose. It also replaces times that differ.

The first call makes the datasets in ``out/check``.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatch
from functools import cached_property
from math import inf
from pathlib import Path
from textwrap import indent
from typing import Any

import yaml

from eval import CONFIGURATION
from eval.metrics import MEASURES, METRICS, Task, measure
from eval.pace import Pace, Timed, paces
from eval.rows.files import method_files, write_text
from eval.rows.store import VALID
from eval.run.attempt import attempt
from eval.run.config import read_choice, resolved, source_of, task_of, with_truth
from eval.run.run import given
from sshade.core.console import progress_bar, say
from sshade.core.errors import InputError

GOLDEN = CONFIGURATION / "golden.yaml"
#: First lines of the values and of the times in the file. The text above them is written by hand.
VALUES, TIMES = "\nvalues:\n", "times:\n"
#: Significant digits of a golden value and of a golden time, and number of differences in a line.
DIGITS, OF_TIME, SHOWN = 7, 3, 3
#: Least relative change of a time that is written.
CHANGED = 0.1


@dataclass(frozen=True)
class GoldenCase:
    """A task, and the methods that run on it by patterns of their names."""

    name: str
    task: str
    methods: Sequence[str] = ("*",)
    without: Sequence[str] = ()
    small: bool = False

    @cached_property
    def source(self) -> dict[str, Any]:
        """The configuration that loads the task."""
        return source_of(resolved("dataset", read_choice(self.task)))

    @cached_property
    def loaded(self) -> Task:
        """The task, without its truth."""
        return task_of(self.source, truth=False)

    def takes(self, method: str) -> bool:
        """Whether a method runs on the task."""
        return _matches(method, self.methods) and not _matches(method, self.without)


@dataclass
class Found:
    """What a method gave: values of its measures by case, or why there are none."""

    method: str
    versions: dict[str, int] = field(default_factory=dict)
    values: dict[str, dict[str, float]] = field(default_factory=dict)
    status: str = "ok"
    reason: str = ""


class GoldenFile:
    """The file of golden values.

    Attributes
    ----------
    path : Path
    head : str
        Text above the values.
    rules : dict
        Content of the head.
    cases : list of GoldenCase
    clock : Timed
    timed : list of Timed
    values : dict
        For each method its versions, and the values of each case.
    times : dict
        Times by name.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        text = path.read_text(encoding="utf-8")
        self.head = text.partition(VALUES)[0]
        self.rules: dict[str, Any] = yaml.safe_load(self.head)
        document = yaml.safe_load(text)
        self.values: dict[str, dict[str, Any]] = document.get(VALUES.strip(":\n")) or {}
        self.times: dict[str, float] = document.get(TIMES.strip(":\n")) or {}
        self.cases = [GoldenCase(name, **facts) for name, facts in self.rules["cases"].items()]
        self.clock, *self.timed = (_timed(name, facts) for name, facts in self.rules["timed"].items())

    def loose(self, method: str) -> Mapping[str, Any]:
        """Return the rule of a method whose results are not reproducible; {} for other methods."""
        return next((rule for rule in self.rules["loose"] if _matches(method, rule["methods"])), {})

    def tolerance(self, method: str, measure: str, golden: float) -> float:
        """Return the largest accepted difference from a golden value."""
        share = self.loose(method).get("tolerance", self.rules["tolerance"])
        unit = METRICS[measure].unit if measure in METRICS else "count"
        if unit != "count":
            return share * max(abs(golden), self.rules["floor"][unit])
        counts = self.rules["counts"]
        return max(counts["least"], counts["tolerance"] * golden) if golden else 0.0

    def differences(self, found: Found, *, unknown: bool = True) -> list[tuple[float, str]]:
        """Return the values that differ: how many times the tolerance, and a text; the largest first.

        `unknown` includes values of measures that the entry has in no case.
        """
        different = []
        entry = self.values.get(found.method, {})
        known = {name for case in found.values for name in entry.get(case, {})}
        for case, values in found.values.items():
            golden = entry.get(case, {})
            for name in [name for name in {**golden, **values} if unknown or name in known]:
                old, new = golden.get(name, inf), values.get(name, inf)  # no value is infinite
                if new != old:
                    most = self.tolerance(found.method, name, old)
                    times = abs(new - old) / most if most and max(old, new) < inf else inf
                    different.append((times, f"{name} of {case} {old:.6g} -> {new:.6g}"))
        return sorted(((times, text) for times, text in different if times > 1), reverse=True)

    def accepts(self, name: str, pace: Pace) -> bool:
        """Whether a time is at most a multiple of its golden time, and the call does not sleep."""
        most = self.rules["slower"] * self.times.get(name, 0.0)
        return pace.time <= most and pace.asleep <= self.rules["asleep"]

    def about(self, name: str, pace: Pace) -> str:
        """Return a line about a time."""
        golden = self.times.get(name)
        if golden is None:
            return f"has no golden time; takes {pace.time:.3g}"
        takes = f"takes {pace.time:.3g}, golden {golden:.3g}"
        if pace.asleep > self.rules["asleep"]:
            return f"sleeps {pace.asleep:.2g} s; {takes}"
        if not self.accepts(name, pace):
            return f"is too slow; {takes}"
        # A golden time that is too long hides slow code.
        return f"is faster; {takes}" if self.rules["slower"] * pace.time < golden else takes

    def write(self, results: Sequence[Found], times: Mapping[str, Pace]) -> None:
        """Write the values of methods with their versions, and times; entries that agree stay as they are.

        An entry gains the values of measures that none of its cases has: a new measure changes no result.

        Raises
        ------
        InputError
            If the values of a method changed, and neither its version nor that of the measures rose.
        """
        entries = dict(self.values)
        for found in results:
            old, changed = self.values.get(found.method), bool(self.differences(found, unknown=False))
            rose = old is None or any(found.versions[name] > old[name] for name in found.versions)
            if changed and not rose:
                raise InputError(
                    f"results of {found.method} changed, and its version did not rise; raise `version` in "
                    f"conf/method/{found.method}.yaml, then write again; nothing was written"
                )
            if changed or rose:
                entries[found.method] = found.versions | found.values
            elif old is not None:
                entries[found.method] = old | {
                    case: {**values, **old.get(case, {})} for case, values in found.values.items()
                }
        new = {name: _rounded(pace.time, OF_TIME) for name, pace in times.items()}
        changed_times = {
            name: time for name, time in new.items() if abs(self.times.get(name, inf) / time - 1) > CHANGED
        }
        parts = [
            indent(yaml.safe_dump(part, default_flow_style=None, width=114), "  ")
            for part in (entries, self.times | changed_times)
        ]
        write_text(self.path, self.head + VALUES + parts[0] + TIMES + parts[1])
        self.values, self.times = entries, self.times | changed_times


def run_method(method: str, golden: GoldenFile) -> Found:
    """Run a method on its cases, and measure the results."""
    found = Found(method)
    for case in (case for case in golden.cases if case.takes(method)):
        small = golden.rules["small"] if case.small else {}
        settings = [text for pattern, text in small.items() if fnmatch(method, pattern)]
        config = resolved("method", read_choice(" ".join([method, *settings])))
        found.versions = {"version": config.get("version", 1), "measures": MEASURES}
        done = attempt(config, given(case.loaded), seed=0)
        found.status, found.reason = done.facts["status"], done.facts["reason"]
        if done.vertices is None:
            break
        values = measure(with_truth(case.loaded, case.source), done.vertices) | {
            "iterations": done.facts["iterations"]
        }
        compared = golden.loose(method).get("measures", values)
        found.values[case.name] = {
            name: _rounded(value, DIGITS) for name in compared if (value := values[name]) is not None
        }
    return found


def report(found: Found, golden: GoldenFile) -> tuple[bool, str]:
    """Return whether a method passes, and a line about it."""
    if found.status not in VALID:
        skipped = found.status == "skipped"
        return skipped, f"{'left out' if skipped else found.status}: {found.reason}"
    entry, different, problems = golden.values.get(found.method), golden.differences(found), []
    if entry is None:
        return False, "has no golden values"
    if different:
        count = sum(map(len, found.values.values()))
        worst = ", ".join(text for _, text in different[:SHOWN])
        problems.append(f"differs in {len(different)} of {count} values: {worst}")
    old = {name: entry[name] for name in found.versions}
    if found.versions != old:
        problems.append(f"has versions {found.versions}, its golden values {old}")
    return not problems, "; ".join(problems) or "agrees"


def make_datasets(datasets: Mapping[str, str], tasks: Sequence[str]) -> None:
    """Make the datasets of tasks that are missing, by ``defaust build``."""
    for folder, settings in datasets.items():
        needed = any(f"root={folder} " in f"{task} " for task in tasks)
        if needed and not Path(folder, "dataset.json").is_file():
            say(f"{folder} is missing; it is made now")
            build = [sys.executable, "-m", "defaust", "build", *shlex.split(settings), f"out={folder}"]
            if subprocess.run(build, stdout=sys.stderr).returncode:
                raise InputError(f"{folder} could not be made; `{shlex.join(build[2:])}` says why")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("methods", nargs="*", metavar="METHOD", help="names in conf/method (default: all)")
    text = "write golden values of new methods and new versions"
    parser.add_argument("--write", action="store_true", help=text)
    text = "also time a body of 170,000 vertices"
    parser.add_argument("--full", action="store_true", help=text)
    text = "the part to compare (default: both); values alone need no quiet machine"
    parser.add_argument("--only", choices=["values", "times"], help=text)


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    golden = GoldenFile(GOLDEN)
    known = [name for name in method_files() if any(case.takes(name) for case in golden.cases)]
    if unknown := [name for name in options.methods if name not in known]:
        raise InputError(f"there is no method {unknown[0]!r} to check; conf/method has the methods")
    methods = options.methods or known
    compared = [] if options.only == "times" else methods
    timed = [one for one in golden.timed if one.method.split()[0] in methods and one.full <= options.full]
    if options.only == "values":
        timed = []
    if not compared and not timed:
        raise InputError(f"no time of {' or '.join(methods)} is measured; conf/golden.yaml has what is timed")
    tasks = [case.task for case in golden.cases] + [one.task for one in (golden.clock, *timed)]
    make_datasets(golden.rules["datasets"], tasks)
    labels = [f"time of {name}" for one in timed for name in one.names]
    width = max(map(len, [*compared, *labels]))
    results, wrong = [], []
    with progress_bar() as progress:
        for done, method in enumerate(compared):
            progress("methods", done, len(compared), method)
            found = run_method(method, golden)
            passes, line = report(found, golden)
            print(f"{method:<{width}}  {line}", flush=True)  # noqa: T201
            results.append(found)
            wrong += [] if passes else [found]
        # Each round can lower a time, so a time to write needs all rounds.
        enough = (lambda *_: False) if options.write else golden.accepts
        times = paces(golden.clock, timed, enough, progress=progress) if timed else {}
    for label, (name, pace) in zip(labels, times.items(), strict=True):
        print(f"{label:<{width}}  {golden.about(name, pace)}")  # noqa: T201
    if options.write and all(found.status in VALID for found in wrong):
        golden.write([found for found in results if found.status in VALID], times)
        print(f"wrote {golden.path}")  # noqa: T201
        wrong = []
    if wrong:
        names = " ".join(found.method for found in wrong)
        print(  # noqa: T201
            "If new results are intended, raise `version` in conf/method/NAME.yaml, or MEASURES if a measure "
            f"changed, and write the golden values: sshade-eval check --write {names}"
        )
    return 0 if not wrong and all(golden.accepts(name, pace) for name, pace in times.items()) else 1


def _timed(name: str, facts: Mapping[str, Any]) -> Timed:
    flags = (facts.get(flag, False) for flag in ("drag", "full"))
    return Timed(name, facts["task"], facts["method"], facts.get("level"), *flags)


def _matches(method: str, patterns: Sequence[str]) -> bool:
    return any(fnmatch(method, pattern) for pattern in patterns)


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")

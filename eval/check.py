"""Compare methods with golden values: ``sshade-eval check [METHOD ...]``.

Each method of ``conf/method`` runs on small tasks. Some also run on a larger one, where their time is counted
in iterations of libigl's Elastic. Measures and times must agree with ``conf/golden.yaml``, which has the
tasks, the golden values and the tolerances. A method whose extra is not installed is left out. Exit code 1 if
a method differs, is too slow, or fails.

If new results are intended, raise `version` in ``conf/method/NAME.yaml``, or `MEASURES` in ``eval/metrics``
where a measure changed. Then ``--write`` replaces the golden values; it refuses where values changed and
neither version rose.

The first call makes the datasets in ``out/check``.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatch
from functools import cached_property
from math import inf
from pathlib import Path
from textwrap import indent
from typing import Any

import yaml

from eval import CONFIGURATION
from eval.metrics import MEASURES, METRICS, Task, measure
from eval.rows.files import write_text
from eval.rows.store import VALID
from eval.run.attempt import Attempt, attempt
from eval.run.config import read_choice, resolved, source_of, task_of, with_truth
from eval.run.run import given
from sshade.core.console import progress_bar, say
from sshade.core.errors import InputError

GOLDEN = CONFIGURATION / "golden.yaml"
#: First line of the values in the file. The text above it is written by hand.
VALUES = "\nvalues:\n"
#: The method whose iterations are the unit of time, and the number of iterations that are timed.
CLOCK, ITERATIONS = "elastic", 10
#: Significant digits of a golden value and of a golden time, and number of differences in a line.
DIGITS, OF_TIME, SHOWN = 7, 3, 3


@dataclass(frozen=True)
class GoldenCase:
    """A task, and the methods that run on it by patterns of their names."""

    name: str
    task: str
    methods: Sequence[str] = ("*",)
    without: Sequence[str] = ()
    small: bool = False
    timed: bool = False

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
    """What a method gave: values of its measures by case, and its time; or why there are none."""

    method: str
    versions: dict[str, int] = field(default_factory=dict)
    values: dict[str, dict[str, float]] = field(default_factory=dict)
    time: float | None = None
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
    values : dict
        For each method its versions, its time, and the values of each case.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        text = path.read_text(encoding="utf-8")
        self.head = text.partition(VALUES)[0]
        self.rules: dict[str, Any] = yaml.safe_load(self.head)
        self.values: dict[str, dict[str, Any]] = yaml.safe_load(text).get(VALUES.strip(":\n")) or {}
        self.cases = [GoldenCase(name, **facts) for name, facts in self.rules["cases"].items()]

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

    def differences(self, found: Found) -> list[tuple[float, str]]:
        """Return the values that differ: how many times the tolerance, and a text; the largest first."""
        different = []
        for case, values in found.values.items():
            golden = self.values.get(found.method, {}).get(case, {})
            for name in {**golden, **values}:
                old, new = golden.get(name, inf), values.get(name, inf)  # no value is infinite
                if new != old:
                    most = self.tolerance(found.method, name, old)
                    times = abs(new - old) / most if most and max(old, new) < inf else inf
                    different.append((times, f"{name} of {case} {old:.6g} -> {new:.6g}"))
        return sorted(((times, text) for times, text in different if times > 1), reverse=True)

    def too_slow(self, found: Found) -> bool:
        """Whether a method takes longer than its golden time allows."""
        golden = self.values.get(found.method, {}).get("time")
        return None not in (golden, found.time) and found.time > self.rules["slower"] * golden

    def write(self, results: Sequence[Found]) -> None:
        """Write the values of methods, and their versions; entries that agree stay as they are.

        An entry gains the values of measures that none of its cases has: a new measure changes no result.

        Raises
        ------
        InputError
            If the values of a method changed, and neither its version nor that of the measures rose.
        """
        entries = dict(self.values)
        for found in results:
            old, changed = self.values.get(found.method), bool(self.differences(self._without_new(found)))
            rose = old is None or any(found.versions[name] > old[name] for name in found.versions)
            if changed and not rose:
                raise InputError(
                    f"results of {found.method} changed, and its version did not rise; raise `version` in "
                    f"conf/method/{found.method}.yaml, then write again; nothing was written"
                )
            if changed or rose or self.too_slow(found):
                time = {} if found.time is None else {"time": _rounded(found.time, OF_TIME)}
                entries[found.method] = found.versions | time | found.values
            elif old is not None:
                entries[found.method] = old | {
                    case: {**values, **old.get(case, {})} for case, values in found.values.items()
                }
        text = yaml.safe_dump(entries, default_flow_style=None, width=114)
        write_text(self.path, self.head + VALUES + indent(text, "  "))

    def _without_new(self, found: Found) -> Found:
        """Return what a method gave, without measures that its entry has in no case."""
        entry = self.values.get(found.method, {})
        known = {name for case in found.values for name in entry.get(case, {})}
        values = {
            case: {name: value for name, value in own.items() if name in known}
            for case, own in found.values.items()
        }
        return replace(found, values=values)


def run_method(method: str, golden: GoldenFile) -> Found:
    """Run a method on its cases, measure the results, and time it where a case asks for it."""
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
        if case.timed:
            found.time = _in_iterations(done, case.loaded)
            if golden.too_slow(found):  # the machine may have been busy
                found.time = _in_iterations(attempt(config, given(case.loaded), seed=0), case.loaded)
    return found


def _in_iterations(done: Attempt, task: Task) -> float:
    """Return the time of a run as a number of iterations of libigl's Elastic, which is timed now."""
    config = resolved("method", read_choice(f"{CLOCK} max_iterations={ITERATIONS} tolerance=0"))
    clock = attempt(config, given(task), seed=0).facts
    return done.facts["seconds.total"] / (clock["seconds.solve"] / clock["iterations"])


def report(found: Found, golden: GoldenFile) -> tuple[bool, str]:
    """Return whether a method passes, and a line about it."""
    if found.status not in VALID:
        skipped = found.status == "skipped"
        return skipped, f"{'left out' if skipped else found.status}: {found.reason}"
    time = "" if found.time is None else f"; takes {found.time:.3g} iterations of {CLOCK}"
    entry, different = golden.values.get(found.method), golden.differences(found)
    if entry is None:
        return False, f"has no golden values{time}"
    time += f", golden {entry['time']:.3g}" if "time" in entry else ""
    problems = ["is too slow"] if golden.too_slow(found) else []
    if different:
        count = sum(map(len, found.values.values()))
        worst = ", ".join(text for _, text in different[:SHOWN])
        problems.append(f"differs in {len(different)} of {count} values: {worst}")
    old = {name: entry[name] for name in found.versions}
    if found.versions != old:
        problems.append(f"has versions {found.versions}, its golden values {old}")
    return not problems, f"{'; '.join(problems) or 'agrees'}{time}"


def make_datasets(datasets: Mapping[str, str]) -> None:
    """Make the datasets that are missing, by ``defaust build``."""
    for folder, settings in datasets.items():
        if not Path(folder, "dataset.json").is_file():
            say(f"{folder} is missing; it is made now")
            build = [sys.executable, "-m", "defaust", "build", *shlex.split(settings), f"out={folder}"]
            if subprocess.run(build, stdout=sys.stderr).returncode:
                raise InputError(f"{folder} could not be made; `{shlex.join(build[2:])}` says why")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("methods", nargs="*", metavar="METHOD", help="names in conf/method (default: all)")
    text = "write golden values of new methods and new versions"
    parser.add_argument("--write", action="store_true", help=text)


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    golden = GoldenFile(GOLDEN)
    paths = [path.relative_to(CONFIGURATION / "method") for path in CONFIGURATION.glob("method/**/*.yaml")]
    known = sorted(path.with_suffix("").as_posix() for path in paths)
    known = [name for name in known if any(case.takes(name) for case in golden.cases)]
    if unknown := [name for name in options.methods if name not in known]:
        raise InputError(f"there is no method {unknown[0]!r} to check; conf/method has the methods")
    methods = options.methods or known
    make_datasets(golden.rules["datasets"])
    results, wrong = [], []
    with progress_bar() as progress:
        for done, method in enumerate(methods):
            progress("methods", done, len(methods), method)
            found = run_method(method, golden)
            passes, line = report(found, golden)
            print(f"{method:<{max(map(len, methods))}}  {line}", flush=True)  # noqa: T201
            results.append(found)
            wrong += [] if passes else [found]
    if options.write and all(found.status in VALID for found in wrong):
        golden.write([found for found in results if found.status in VALID])
        print(f"wrote {golden.path}")  # noqa: T201
        return 0
    if wrong:
        names = " ".join(found.method for found in wrong)
        print(  # noqa: T201
            "If new results are intended, raise `version` in conf/method/NAME.yaml, or MEASURES if a measure "
            f"changed, and write the golden values: sshade-eval check --write {names}"
        )
    return 1 if wrong else 0


def _matches(method: str, patterns: Sequence[str]) -> bool:
    return any(fnmatch(method, pattern) for pattern in patterns)


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")

"""Write a benchmark that benchopt runs: ``sshade-eval benchopt DIR --methods ... --cases ...``.

The folder DIR gets one objective (all metrics of this evaluator), one dataset with the cases, and one solver
for each method. benchopt repeats runs, times them, and collects results of many benchmarks; the figures are
those of `sshade-eval run` with seed 0. Both commands need the packages sshade[bench] and benchopt:

  sshade-eval benchopt out/benchopt --methods paper fast accelerated_elastic \\
    --cases "defaust root=data/defaust_20k subject=0,1 pose=1,2"
  benchopt run out/benchopt

A method or a case is [LABEL=]NAME [KEY=VALUE ...], with NAME in conf/method or conf/dataset. Paths of cases
become absolute, so the folder is for this machine.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping
from pathlib import Path
from pprint import pformat
from typing import Any

from eval.configure.compose import one_each, read_choice
from eval.rows.files import write_text
from eval.timing.cases import read_cases, read_methods
from sshade.errors import InputError

OBJECTIVE = '''"""All metrics of sshade-eval, on the deformed vertices."""

from benchopt import BaseObjective

from eval.run.measures import measures_of


class Objective(BaseObjective):
    name = "DeFAUST"
    requirements = ["pip::sshade[bench]"]
    min_benchopt_version = "1.10"
    sampling_strategy = "run_once"

    def set_data(self, task):
        self.task = task

    def get_objective(self):
        return {"task": self.task}

    def evaluate_result(self, vertices):
        return measures_of(self.task, vertices)

    def get_one_result(self):
        return {"vertices": self.task.mesh.V}
'''

DATASET = '''"""Cases to deform, each a rest mesh with handles."""

from benchopt import BaseDataset

from eval.run.targets import instantiate

CASES = {cases}


class Dataset(BaseDataset):
    name = "cases"
    parameters = {{"case": list(CASES)}}
    requirements = ["pip::sshade[bench]"]

    def get_data(self):
        return {{"task": instantiate(CASES[self.case])}}
'''

SOLVER = '''"""The method {name} with its options."""

from math import inf  # noqa: F401, the value of some options

from benchopt import BaseSolver

from eval.timing.cases import TimedMethod

METHOD = {config}


class Solver(BaseSolver):
    name = "{name}"
    requirements = ["pip::sshade[bench]"]

    def set_objective(self, task):
        self.call = TimedMethod(self.name, METHOD).on(task)  # compiles on a tiny task

    def run(self, _):
        self.result = self.call()

    def get_result(self):
        return {{"vertices": self.result.vertices}}
'''


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder to make")
    parser.add_argument("--methods", nargs="+", required=True, metavar="METHOD", help="methods, see above")
    parser.add_argument("--cases", nargs="+", required=True, metavar="CASE", help="cases, see above")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    files = benchmark(options.methods, options.cases)
    folder: Path = options.folder
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder} exists; give a new or an empty folder")
    for name, text in files.items():
        write_text(folder / name, text)
    print(f"{folder}: {len(files) - 2} solvers; `benchopt run {folder}`")  # noqa: T201
    return 0


def benchmark(methods: list[str], cases: list[str]) -> dict[str, str]:
    """Return the texts of a benchopt benchmark by their file names.

    Parameters
    ----------
    methods, cases : list of str
        Texts of choices.

    Raises
    ------
    InputError
        When a choice cannot be resolved, a dataset is missing, two methods or cases have the same name, or
        the label of a method is no name of a module.
    """
    found = read_methods(methods, blocks={})
    if wrong := [method.label for method in found if not re.fullmatch(r"\w+", method.label)]:
        raise InputError(f"{wrong[0]!r} is no name of a module; give a label of letters, digits and _")
    choices = [one for text in cases for one in one_each(read_choice(text))]
    labels = [
        " ".join([choice.label, *(word for word in choice.settings if not word.startswith("root="))])
        for choice in choices
    ]
    if twice := [label for label in labels if labels.count(label) > 1]:
        raise InputError(f"two cases are named {twice[0]!r}; name one of them LABEL=NAME")
    sources = {label: _absolute(case.source) for label, case in zip(labels, read_cases(cases), strict=True)}
    files = {"objective.py": OBJECTIVE, "datasets/cases.py": DATASET.format(cases=pformat(sources))}
    for method in found:
        config = pformat(method.config, width=100)
        files[f"solvers/{method.label}.py"] = SOLVER.format(name=method.label, config=config)
    return files


def _absolute(source: Mapping[str, Any]) -> dict[str, Any]:
    """Return the configuration of a case with absolute paths."""
    return {
        key: str(Path(value).resolve()) if isinstance(value, str) and Path(value).exists() else value
        for key, value in source.items()
    }

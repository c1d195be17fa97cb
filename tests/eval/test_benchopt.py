"""The export of a benchmark to benchopt refuses mistakes, and benchopt finds the same numbers."""

import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from eval.main import main
from eval.metrics import measure
from eval.run.attempt import attempt
from eval.run.targets import instantiate
from eval.timing.cases import read_cases, read_methods
from tests.robustness.case import assert_refused

METHODS = ["paper samplings=2 vertices=150", "fast vertices=150", "accelerated_elastic"]


def test_what_is_written(case, capsys):
    assert main(["benchopt", "out/ball", "--methods", *METHODS, "--cases", case]) == 0
    assert "3 solvers; `benchopt run out/ball`" in capsys.readouterr().out
    assert str(Path("rest.ply").resolve()) in Path("out/ball/datasets/cases.py").read_text()
    for path in Path("out/ball").rglob("*.py"):
        compile(path.read_text(), path, "exec")


@pytest.mark.parametrize(
    ("folder", "methods", "repeated", "message"),
    [
        ("new", ["a-b=fast"], 1, "'a-b' is no name of a module"),
        ("new", ["fast", "fast"], 1, "two methods are named 'fast'"),
        ("new", ["fast"], 2, "two cases are named"),
        ("new", ["nothing"], 1, "nothing"),
        ("full", ["fast"], 1, "full exists; give a new or an empty folder"),
    ],
)
def test_refused_in_one_sentence(case, folder, methods, repeated, message):
    Path("full").mkdir()
    Path("full/file").touch()
    arguments = ["benchopt", folder, "--methods", *methods, "--cases", *[case] * repeated]
    assert_refused("sshade-eval", arguments, message)


def test_benchopt_finds_the_same_figures(case):
    pytest.importorskip("benchopt", reason="the extra hubs is not installed")
    assert main(["benchopt", "out/ball", "--methods", *METHODS, "--cases", case]) == 0
    arguments = ["-m", "benchopt", "run", "out/ball", "--no-plot", "--max-runs", "1"]
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
    [results] = Path("out/ball/outputs").glob("*.parquet")
    found = pd.read_parquet(results).set_index("solver_name")
    [source] = read_cases([case])
    task = instantiate(source.source)
    for method in read_methods(METHODS, blocks={}):
        for name, value in measure(task, attempt(method.config, task, seed=0).vertices).items():
            if value is not None:
                assert found.at[method.label, f"objective_{name}"] == value

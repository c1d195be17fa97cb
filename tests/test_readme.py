"""README.md and docs/start.md run word for word, and pages list every experiment and all published rows."""

import os
import re
import shlex
import subprocess
import sys
import tomllib
from contextlib import chdir
from pathlib import Path
from typing import Any
from unittest import mock
from urllib.request import urlopen

import numpy as np
import pytest

import sshade
from docs.pages import BLOCK
from eval import CONFIGURATION
from eval.rows.frame import read_csv
from eval.rows.splits import HELD_OUT, read_splits, split_of
from tests.robustness.case import run

ROOT = Path(__file__).parents[1]
NAMES = ["README.md", "docs/start.md", "docs/tracks.md", "results/README.md", "Makefile", "pyproject.toml"]
README, START, LIST, RESULTS, MAKEFILE, PROJECT = ((ROOT / name).read_text("utf-8") for name in NAMES)
PAGES = (README, START)
EXTRAS = {*tomllib.loads(PROJECT)["project"]["optional-dependencies"]}


def test_the_page_lists_every_experiment_with_its_split():
    listed = dict(re.findall(r"^\| `(\w+)` \| (\w+) \|", LIST, re.MULTILINE))
    split = {
        path.stem: re.search(r"^  split: (\w+)$", path.read_text(), re.MULTILINE)
        for path in CONFIGURATION.glob("experiment/*.yaml")
    }
    assert listed == {name: match[1] for name, match in split.items()}
    assert set(listed.values()) <= {*read_splits(), "both"}


def test_the_page_lists_all_published_rows():
    (rows,) = (block["old"] for block in BLOCK.finditer(RESULTS) if block["name"] is None)
    listed = re.findall(r"^\| `(\w+)` \|", rows, re.MULTILINE)
    assert sorted(listed) == sorted(path.stem for path in ROOT.glob("results/rows/*.csv"))


def test_the_numbers_of_the_readme_are_those_of_the_rows():
    words = " ".join(README.split())
    rows = read_csv(ROOT / "results/rows/bodies_170k.csv")
    assert {split_of(task) for task in rows["task.name"]} == {HELD_OUT}
    rows = rows[rows["method.name"] != "fine_free"]
    truth = rows.pivot(index="task.name", columns="method.name", values="metric.truth_distance")
    others = truth[["accelerated_elastic", "deformation_graph", "paper"]].min(axis=1)
    assert (others > truth["fine"]).all() and len(truth) == 30
    assert "`fine` is nearer to the true pose than these three in all 30 cases" in words
    assert f"(docs/results.md#new-bodies-in-new-poses), `fast` in {(others > truth['fast']).sum()}." in words
    means = (ROOT / "docs/results.md").read_text("utf-8")
    nearer = re.search(r"to accelerated_elastic -(\S+) \[-(\S+), -(\S+)\]", means)
    assert f"`fast` is nearer than Elastic by {nearer[1]} [{nearer[3]}, {nearer[2]}]," in words
    counts = re.search(r"^\| all \|.*\| (\d+) / \d+ / (\d+) of (\d+) \|$", means, re.M)
    assert f"`fast` is nearer in {counts[2]} and {counts[1]} of {counts[3]} cases" in words
    people = read_csv(ROOT / "results/rows/faust_170k.csv").drop_duplicates("task.name")
    free = (people["task.meta.n_static"] == 0).sum()
    assert f"so {free} of the {len(people)} cases have no fixed handle at all" in " ".join(LIST.split())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder in which the commands of both pages have run, in their order and once each."""
    path = tmp_path_factory.mktemp("pages")
    for page in PAGES:
        for handles in blocks(page, "json"):
            (path / "handles.json").write_text(handles)
    programs = {"BROWSER": "true", "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    commands = "".join(block for page in PAGES for block in blocks(page) if not block.startswith("git clone"))
    for line in dict.fromkeys(commands.replace("\\\n", "").splitlines()):
        program, *arguments = shlex.split(line)
        if program == "pip":
            assert set(re.findall(r"[\w-]+", arguments[-1])) <= EXTRAS
        elif program == "make":
            assert re.search(rf"^{arguments[0]}:", MAKEFILE, re.M)
        elif "edit" in arguments:
            edit(line, cwd=path, env=os.environ | programs)
        else:
            with chdir(path), mock.patch("webbrowser.open"):
                code, _, said = run(line)
            assert code == 0, said
    return path


def test_the_readme_installs_into_an_environment_in_a_clone(tmp_path):
    """Git and the environment are real; the last command only looks where it would install."""
    (commands,) = (block for block in blocks(README) if block.startswith("git clone"))
    instead = 'python3() { command python3 "$@" --without-pip; }\n'
    instead += 'pip() { test "$*" = "install ." && test -f pyproject.toml && test -n "$VIRTUAL_ENV"; }\n'
    subprocess.run(["bash", "-ec", instead + commands.replace("URL", str(ROOT))], cwd=tmp_path, check=True)


def blocks(page: str, language: str = "") -> list[str]:
    """The contents of a page's blocks in a language; commands have none."""
    found = re.findall(r"^```(\w*)\n(.*?)^```$", page, re.M | re.S)
    return [content for name, content in found if name == language]


def edit(line: str, **options: Any) -> None:
    """Start the editor and end it when its page answers."""
    words = shlex.split(f"{line} --no-browser")
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, **options) as run:
        with urlopen(run.stdout.readline().strip()) as answer:
            assert b"<title>sshade" in answer.read()
        run.terminate()


@pytest.mark.parametrize("page", PAGES, ids=["README.md", "docs/start.md"])
def test_the_python_of_a_page_runs_after_its_commands(page, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    names: dict[str, Any] = {}
    for block in blocks(page, "python"):
        exec(block, names)
    leaning = sshade.read("leaning.ply").V
    assert np.abs(leaning[names["b"]] - names["bc"]).max() < 1e-6
    moved = (names["bc"] != names["V"][names["b"]]).any(axis=1)
    assert moved.sum() > 100 < (~moved).sum()
    assert all(0 < float(distance) < 1 for distance in capsys.readouterr().out.split())


def test_the_commands_of_the_pages_leave_the_files_that_the_pages_name(folder):
    named = {"posed.ply", "moved.ply", "example/rest.ply", *(f"example/pose_{k}.json" for k in (1, 6, 8))}
    assert [name for name in named if not (folder / name).is_file()] == []
    assert sshade.read(folder / "example/rest.ply").V.shape == (110_210, 3)
    assert max(len(page.splitlines()) for page in PAGES) <= 100
    assert {line for page in PAGES for line in re.findall(r"^pip .*", page, re.M)} == {"pip install ."}
    assert re.search(r"```\nmake tables .*\nmake test .*\n```", README)

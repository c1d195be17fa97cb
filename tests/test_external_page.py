"""docs/external.md: its configuration and its commands work, on a small task in place of the bodies."""

import os
import re
import shlex
import shutil
import sys
from pathlib import Path

import pytest

from eval.main import main
from eval.rows.store import read_row, run_folders
from eval.run.config import read_choice, resolved
from sshade.files.task_files import read_handles
from tests.shapes import bumpy

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/external.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, re.M | re.S)
#: The commands of the page, one a line.
COMMANDS = "".join(text for kind, text in BLOCKS if not kind).replace("\\\n", "").splitlines()


def block(kind):
    (text,) = (text for name, text in BLOCKS if name == kind)
    return text


def commands(*words):
    return [shlex.split(line) for line in COMMANDS if all(word in line for word in words)]


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """A folder like a clone, with the folder `mine` of the page beside it."""
    clone, mine = tmp_path / "clone", tmp_path / "mine"
    (clone / "docs").mkdir(parents=True)
    (clone / "docs/examples").symlink_to(ROOT / "docs/examples")
    monkeypatch.chdir(clone)
    for command in ("mkdir -p ../mine/conf/method", "cp docs/examples/external/biharmonic.py ../mine/"):
        assert command in COMMANDS
        program, *arguments = shlex.split(command)
        Path(arguments[-1]).mkdir(parents=True) if program == "mkdir" else shutil.copy(*arguments)
    python = mine / ".venv/bin/python"
    python.parent.mkdir(parents=True)
    python.write_text(f'#!/bin/sh\nexec {sys.executable} -I "$@"\n')
    python.chmod(0o755)
    assert "`../mine/conf/method/mine.yaml`" in PAGE
    (mine / "conf/method/mine.yaml").write_text(block("yaml"))
    return clone


@pytest.mark.skipif(os.name != "posix", reason="the page is for a shell")
def test_the_runs_of_the_page_work(clone):
    single = [line for line in commands("sshade-eval run", "dataset=") if "-m" not in line]
    assert len(single) == 2
    for _, _, *words in single:
        small = [word for word in words if not word.startswith(("dataset=", "subject=", "pose="))]
        assert main(["run", *small, "dataset=hairpin"]) == 0
    rows = [read_row(folder) for folder in run_folders(clone / "out/runs/single")]
    assert {(row["method.name"], row["status"]) for row in rows} == {("mine", "ok"), ("nearest", "ok")}
    assert all(row["seconds.startup"] > 0 and row["metric.handle"] < 1e-9 for row in rows)


@pytest.mark.skipif(os.name != "posix", reason="the page is for a shell")
def test_the_sweep_and_the_bench_of_the_page_name_the_same_program(clone, capsys):
    ((_, _, *words),) = commands("sshade-eval run -m")
    said = "the dataset folder ./data/defaust_25k does not exist"
    assert main(["run", "-m", *words]) == 2 and said in capsys.readouterr().err
    ((*_, method),) = commands("sshade-eval bench")
    plain = resolved("method", read_choice(method))
    assert plain["command"] == ["../mine/.venv/bin/python", "../mine/biharmonic.py"]
    assert [plain[f"{name}_format"] for name in ("mesh", "handles", "output")] == ["off", "txt", "npy"]


def test_the_page_builds_the_data_of_the_experiment():
    (words,) = commands("defaust build")
    built = resolved("dataset", read_choice("defaust_25k root=data/defaust_25k"))["build"]
    assert words == [*built.split(), "subjects=[5,6,7,8,9]"]


def test_the_handles_of_the_page_are_read(tmp_path):
    (tmp_path / "handles.json").write_text(block("json"))
    handles = read_handles(tmp_path / "handles.json", bumpy(2))
    assert handles.index.tolist() == [3, 8, 17] and handles.dynamic.tolist() == [False, False, True]
    line = re.search(r"^17 (.*)$", PAGE, re.M)[1]
    assert handles.target[2].tolist() == [float(word) for word in line.split()]

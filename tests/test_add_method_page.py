"""docs/add_method.md: its files and its commands work, on a small task in place of the bodies."""

import os
import re
import shlex
import shutil
import sys
from pathlib import Path

import pytest

from eval.main import main
from eval.rows.frame import read_csv
from eval.rows.store import read_row, run_folders
from eval.run.config import composed
from sshade import read_handles
from tests.shapes import bumpy

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/add_method.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, re.M | re.S)
#: The commands of the page, one a line.
COMMANDS = "".join(text for kind, text in BLOCKS if not kind).splitlines()
#: Settings of a command that choose its cases.
CASES = ("dataset.root=", "experiment=", "subject=", "pose=")

pytestmark = pytest.mark.skipif(os.name != "posix", reason="the page is for a shell")


def blocks(kind):
    return [text for name, text in BLOCKS if name == kind]


def commands(*words):
    """Return the arguments of the commands that begin with some words."""
    split = [shlex.split(line) for line in COMMANDS]
    return [line[len(words) :] for line in split if line[: len(words)] == [*words]]


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """The folder of the page, beside a folder like a clone, with the files that a reader saves."""
    mine, examples = tmp_path / "mine", tmp_path / "sshade/docs/examples"
    examples.parent.mkdir(parents=True)
    examples.symlink_to(ROOT / "docs/examples")
    monkeypatch.chdir(tmp_path)
    for folder in (folder for arguments in commands("mkdir", "-p") for folder in arguments):
        Path(folder).mkdir(parents=True)
    monkeypatch.chdir(mine)
    monkeypatch.setenv("PYTHONSAFEPATH", "")  # the command sets it, and it would stay for other tests
    monkeypatch.syspath_prepend(mine)
    monkeypatch.delitem(sys.modules, "mymethod", raising=False)
    shutil.copy(*commands("cp")[0])
    files = ("mymethod.py", "conf/method/mymethod.yaml", "conf/method/myprogram.yaml")
    for name, text in zip(files, [*blocks("python"), *blocks("yaml")], strict=True):
        assert f"`{name}`" in PAGE
        (mine / name).write_text(text)
    programs = tmp_path / "bin"
    programs.mkdir()
    (programs / "python3").write_text(f'#!/bin/sh\nexec {sys.executable} -I "$@"\n')
    (programs / "python3").chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
    return mine


def test_the_function_and_the_program_of_the_page_run_on_one_case(mine):
    single = [words for words in commands("sshade-eval", "run") if "-m" not in words]
    assert len(single) == 2
    for words in single:
        assert main(["run", *(word for word in words if not word.startswith(CASES)), "dataset=hairpin"]) == 0
    function, program = (read_row(folder) for folder in run_folders(mine / "out/runs/single"))
    for row, name in ((function, "mymethod"), (program, "myprogram")):
        assert (row["method.name"], row["status"], row["method.version"]) == (name, "ok", 1)
        assert row["metric.handle"] < 1e-9
    assert 0 < program["seconds.reported"] < program["seconds.program"] and program["iterations"] == 1
    (note,) = re.findall(r"^note: (.*)$", blocks("yaml")[0], re.M)
    assert function["method.note"] == note


@pytest.mark.full
def test_several_values_with_labels_make_a_table(mine):
    (words,) = (shlex.split(text) for text in re.findall(r"`(-m method\.[^`]+)`", PAGE))
    several = ["--config-dir", "conf", "method=mymethod", "run.experiment=mine", "dataset=hairpin"]
    assert main(["run", *words, *several]) == 0
    assert all(main([command, "mine"]) == 0 for command in ("collect", "tables"))
    assert set(read_csv("out/rows/mine.csv")["method.name"]) == {"mymethod-1", "mymethod-10"}


def test_the_sweeps_of_the_page_name_experiments_methods_and_the_data_that_the_page_builds(mine, capsys):
    sweeps = [words for words in commands("sshade-eval", "run") if "-m" in words]
    assert len(sweeps) == 3
    for words in sweeps:
        root = composed([word for word in words if word.startswith("experiment=")]).dataset.root
        assert main(["run", *words, "subject=all"]) == 2
        assert f"the dataset folder {root} does not exist" in capsys.readouterr().err
        (method,) = (word for word in words if word.startswith("method="))
        for name in method.removeprefix("method=").split(","):
            assert composed([f"method={name}"], folder=str(mine / "conf")).method.version >= 1


def test_the_handles_of_the_page_are_read(tmp_path):
    (text,) = blocks("json")
    (tmp_path / "handles.json").write_text(text)
    handles = read_handles(tmp_path / "handles.json", bumpy(2))
    assert handles.index.tolist() == [3, 8, 17] and handles.dynamic.tolist() == [False, False, True]
    line = re.search(r"`17 ([^`]*)`", PAGE)[1]
    assert handles.target[2].tolist() == [float(word) for word in line.split()]

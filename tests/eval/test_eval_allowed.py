"""Functions named by configurations and rows: only known ones are called, others with leave alone."""

from __future__ import annotations

import sys

import pytest
import yaml

from eval.run.allowed import (
    VARIABLE,
    allow_from,
    check_folders,
    require_allowed,
)
from eval.run.recall import load_task
from sshade.cli.configuration import CONFIGURATION, named_functions
from sshade.errors import InputError
from tests.robustness.case import contents, run


@pytest.fixture(autouse=True)
def nobody_allowed_anything(monkeypatch):
    monkeypatch.setenv(VARIABLE, "")


def test_what_the_project_s_conf_names_is_allowed():
    files = [yaml.safe_load(path.read_text()) for path in CONFIGURATION.rglob("*.yaml")]
    assert len(files) > 30
    require_allowed(files, where="conf")
    assert {"defaust.tasks.load_task", "defaust.tasks.list_tasks"} <= named_functions()


@pytest.mark.parametrize(
    "name",
    [
        "os.system",
        "defaust.folder.layout.write_text",
        "sshade.io.meshes.write_mesh",
        "sshade.pipeline.deform.deform.x",
        "",
        None,
        3,
        ["a"],
    ],
)
@pytest.mark.parametrize("key", ["_target_", "cases", "class", "()"])
def test_anything_else_is_not(name, key):
    with pytest.raises(InputError, match=r"the file names the function .*run\.allow_targets=\["):
        require_allowed([{"method": {"coarse": {key: name}}}], where="the file")


def test_parameters_called_cases_may_be_anything_but_a_name():
    require_allowed({"cases": {"a": [1]}, "list": [{"_target_": "baselines.arap.arap"}]}, where="x")


def test_the_command_line_allows_beginnings():
    allow_from(["method=x", "run.allow_targets=[mypackage., other.f]"])
    allow_from(["+run.allow_targets='third.'"])
    require_allowed([{"_target_": name} for name in ("mypackage.a.b", "other.f", "third.f")], where="x")
    with pytest.raises(InputError, match="mypackages.a"):
        require_allowed({"_target_": "mypackages.a"}, where="x")


def test_folders_are_checked_whole(tmp_path):
    folder = tmp_path / "hydra" / "launcher"
    folder.mkdir(parents=True)
    (folder / "quick.yaml").write_text("_target_: subprocess.Popen\nargs: [true]\n")
    with pytest.raises(InputError, match="quick.yaml names the function subprocess.Popen"):
        check_folders([str(tmp_path)])
    for overrides in (
        [f"hydra.searchpath=[file://{tmp_path}]"],
        [f"+hydra.searchpath=['{tmp_path}', pkg://x]"],
    ):
        with pytest.raises(InputError, match="subprocess.Popen"):
            check_folders([None], overrides=overrides)
    (folder / "quick.yaml").write_text("_target_: ${oc.env:WHAT}\n")
    with pytest.raises(InputError, match="names the function"):
        check_folders([str(tmp_path)])
    (folder / "quick.yaml").write_text("version: 1\nhandlers:\n  run: {class: subprocess.Popen, args: ls}\n")
    with pytest.raises(InputError, match="names the function subprocess.Popen"):
        check_folders([str(tmp_path)])
    for text, name in (
        ("hydra:\n  searchpath: [/elsewhere]\n", "searchpath"),
        ("# @package hydra.job.env_set\nPYTHONPATH: /elsewhere\n", "env_set"),
        ("defaults:\n- theirs@hydra.job.env_set: a\n", "env_set"),
        ("# @package _global_\nhydra: {launcher: {setup: [ls]}}\n", "setup"),
        ('# @package hydra.launcher\n"se\\x74up": [ls]\n', "setup"),
    ):
        (folder / "quick.yaml").write_text(text)
        with pytest.raises(InputError, match=f"sets hydra's {name}, which is for the command line alone"):
            check_folders([str(tmp_path)])
    (folder / "quick.yaml").write_text("!!python/object/apply:os.system [touch hacked]\n")
    with pytest.raises(InputError, match="not readable as YAML"):
        check_folders([str(tmp_path)])
    (folder / "quick.yaml").write_text("_target_: baselines.arap.arap\n---\nmore: 1\n")
    check_folders([str(tmp_path), None, str(tmp_path / "missing")])


def test_a_row_that_names_another_function_does_not_call_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    row = {"task.name": "t", "task.source": '{"_target_": "pathlib.Path", "cases": 1}', "task.checksum": "x"}
    with pytest.raises(InputError, match="the row of t names the function pathlib.Path"):
        load_task(row)


@pytest.fixture
def theirs(tmp_path, monkeypatch):
    """A module, and a folder of configurations that names a function of it."""
    (tmp_path / "theirs.py").write_text(
        "from pathlib import Path\nfrom baselines.identity import identity\n"
        "def method(task, *, seed, progress=None):\n    Path('called').touch()\n"
        "    return identity(task, seed=seed)\n"
        "def task():\n    from eval.run.warmup import tiny_task\n    return tiny_task()\n"
    )
    for name, target in (("method/theirs", "method"), ("dataset/theirs", "task")):
        path = tmp_path / "configs" / f"{name}.yaml"
        path.parent.mkdir(parents=True)
        path.write_text(f"_target_: theirs.{target}\n")
    (tmp_path / "configs/experiment").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "theirs", raising=False)
    return tmp_path


def refused(command, *words):
    """The one line on standard error of a command that left no file."""
    before = contents()
    code, out, err = run(f"sshade-eval run {command}")
    assert (code, out) == (2, "") and err.startswith("error: ") and err.count("\n") == 1, err
    assert all(word in err for word in words), err
    assert contents() == before


def test_a_folder_of_configurations_calls_nothing_without_leave(theirs):
    command = "-cd configs method=theirs dataset=theirs"
    refused(
        command, "configs/dataset/theirs.yaml names the function theirs.task", "run.allow_targets=[theirs.]"
    )
    code, _, err = run(f"sshade-eval run {command} run.allow_targets=[theirs.]")
    assert code == 0 and (theirs / "called").exists(), err


def test_a_file_cannot_give_itself_leave(theirs):
    leave = "# @package _global_\nrun:\n  allow_targets: [theirs.]\n"
    (theirs / "configs/experiment/e.yaml").write_text(leave)
    refused("-cd configs experiment=e method=theirs dataset=hairpin", "names the function theirs.")


@pytest.mark.parametrize("flag", ["--config-path configs", "--experimental-rerun config.pickle"])
def test_flags_that_replace_the_configuration_are_refused(theirs, flag):
    refused(f"{flag} method=identity dataset=hairpin", "is not for this program; --config-dir adds")


@pytest.mark.parametrize(
    "arguments",
    [
        "dataset=hairpin method=identity method._target_=os.system",
        "dataset=hairpin method=identity dataset._target_=shutil.rmtree",
        "dataset=hairpin method=sshade method.coarse._target_=os.system",
        "-m dataset=defaust dataset.root=. method=identity pose=all dataset.cases=os.listdir",
    ],
)
def test_a_name_on_the_command_line_needs_leave_too(theirs, arguments):
    refused(arguments, "names the function")

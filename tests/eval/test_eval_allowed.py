"""Functions named by configurations and rows: only known ones are called, others with leave alone."""

from __future__ import annotations

import sys

import pytest
import yaml

from eval.configure.allowed import (
    VARIABLE,
    allow_from,
    check_folders,
    is_allowed,
    require_allowed,
    require_from_command_line,
)
from eval.rows.recall import load_task
from sshade.cli.configuration import CONFIGURATION, named_functions
from sshade.errors import InputError
from tests.robustness.case import contents, run


@pytest.fixture(autouse=True)
def nobody_allowed_anything(monkeypatch):
    monkeypatch.setenv(VARIABLE, "")


def test_what_the_conf_package_names_is_allowed():
    found = set()

    def walk(value):
        if isinstance(value, dict):
            found.update(value[key] for key in ("_target_", "cases") if isinstance(value.get(key), str))
        for part in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
            walk(part)

    files = list(CONFIGURATION.rglob("*.yaml"))
    for path in files:
        walk(yaml.safe_load(path.read_text()))
    assert len(files) > 30 and found == named_functions() and all(map(is_allowed, found))
    assert {
        "sshade.pipeline.deform.deform",
        "defaust.tasks.load_task",
        "defaust.tasks.list_tasks",
    } <= found


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
def test_anything_else_is_not(name):
    assert not is_allowed(name)
    with pytest.raises(InputError, match=r"the file names the function .*run\.allow_targets=\["):
        require_allowed([{"method": {"coarse": {"_target_": name}}}], where="the file")


def test_parameters_called_cases_may_be_anything_but_a_name():
    require_allowed({"cases": {"a": [1]}, "list": [{"_target_": "baselines.arap.arap"}]}, where="x")


def test_the_command_line_allows_beginnings(monkeypatch):
    allow_from(["method=x", "run.allow_targets=[mypackage., other.f]"])
    assert is_allowed("mypackage.a.b") and is_allowed("other.f") and not is_allowed("mypackages.a")
    allow_from(["+run.allow_targets='third.'"])
    assert is_allowed("third.f") and is_allowed("mypackage.a")
    require_from_command_line(["mypackage.", "third."])
    require_from_command_line(None)
    for texts in (["mypackage.", "os."], "os.", True):
        with pytest.raises(InputError, match="for the command line alone"):
            require_from_command_line(texts)


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
    (folder / "quick.yaml").write_text("hydra:\n  searchpath: [/elsewhere]\n")
    with pytest.raises(InputError, match="adds a search path"):
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
    (theirs / "configs/experiment/e.yaml").write_text(
        "# @package _global_\nrun:\n  allow_targets: [theirs.]\n"
    )
    for path in (theirs / "configs/method/theirs.yaml", theirs / "configs/dataset/theirs.yaml"):
        path.unlink()
    refused("-cd configs experiment=e method=identity dataset=hairpin", "for the command line alone")


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

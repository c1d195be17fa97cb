"""Configurations and rows may name known functions; other functions are called only with permission."""

import sys

import pytest
import yaml

from eval.configure.typed import listed
from eval.run.allowed import OVERRIDE, VARIABLE, allow_functions, check_folders, require_allowed
from sshade.cli.configuration import CONFIGURATION, named_functions
from sshade.core.errors import InputError
from tests.robustness.case import assert_refused, run


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
    ["os.system", "sshade.files.meshes.write_mesh", "sshade.method.deform.deform.x", "", None, 3, ["a"]],
)
@pytest.mark.parametrize("key", ["_target_", "cases", "class", "()"])
def test_anything_else_is_not(name, key):
    with pytest.raises(InputError, match=r"the file names the function .*run\.allow_targets=\["):
        require_allowed([{"method": {"coarse": {key: name}}}], where="the file")


def test_the_command_line_allows_beginnings():
    allow_functions(listed(["method=x", "run.allow_targets=[mypackage., 'other.f']"], OVERRIDE))
    allow_functions(listed(["+run.allow_targets='third.'"], OVERRIDE))
    require_allowed([{"_target_": name} for name in ("mypackage.a.b", "other.f", "third.f")], where="x")
    with pytest.raises(InputError, match="mypackages.a"):
        require_allowed({"_target_": "mypackages.a"}, where="x")


@pytest.fixture
def quick(tmp_path):
    """Return the path of a file in a folder of configurations."""
    path = tmp_path / "hydra" / "launcher" / "quick.yaml"
    path.parent.mkdir(parents=True)
    return path


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("_target_: subprocess.Popen\nargs: [true]\n", "quick.yaml names the function subprocess.Popen"),
        ("_target_: ${oc.env:WHAT}\n", "names the function"),
        ("handlers:\n  run: {class: subprocess.Popen, args: ls}\n", "names the function subprocess.Popen"),
        ("hydra:\n  searchpath: [/elsewhere]\n", "sets hydra's searchpath, which is for the command line"),
        ("# @package hydra.job.env_set\nPYTHONPATH: /elsewhere\n", "sets hydra's env_set"),
        ("defaults:\n- theirs@hydra.job.env_set: a\n", "sets hydra's env_set"),
        ("# @package _global_\nhydra: {launcher: {setup: [ls]}}\n", "sets hydra's setup"),
        ('# @package hydra.launcher\n"se\\x74up": [ls]\n', "sets hydra's setup"),
        ("!!python/object/apply:os.system [touch hacked]\n", "not readable as YAML"),
    ],
)
def test_folders_are_checked_whole(quick, tmp_path, text, words):
    quick.write_text(text)
    with pytest.raises(InputError, match=words):
        check_folders([str(tmp_path)])
    tmp_path.rename(odd := tmp_path.with_name(f"{tmp_path.name} a,b"))
    for override in (f"hydra.searchpath=['file://{odd}']", f"+hydra.searchpath=['{odd}', pkg://x]"):
        with pytest.raises(InputError, match=words):
            check_folders([None, *listed(["seed=1", override], "hydra.searchpath")])


@pytest.fixture
def theirs(here, monkeypatch):
    """Write a module, and a folder of configurations that name the module's functions."""
    (here / "theirs.py").write_text(
        "from pathlib import Path\nfrom baselines.identity import identity\n"
        "def method(task, *, seed, progress=None):\n    Path('called').touch()\n"
        "    return identity(task, seed=seed)\n"
        "def task():\n    from eval.run.warmup import tiny_task\n    return tiny_task()\n"
    )
    for name, target in (("method/theirs", "method"), ("dataset/theirs", "task")):
        path = here / "configs" / f"{name}.yaml"
        path.parent.mkdir(parents=True)
        path.write_text(f"_target_: theirs.{target}\n")
    (here / "configs/experiment").mkdir()
    monkeypatch.syspath_prepend(here)
    monkeypatch.delitem(sys.modules, "theirs", raising=False)
    return here


def refused(command, *words):
    assert_refused("sshade-eval", ["run", *command.split()], *words)


def test_a_folder_of_configurations_calls_nothing_without_leave(theirs):
    command = "-cd configs method=theirs dataset=theirs"
    words = "configs/dataset/theirs.yaml names the function theirs.task", "run.allow_targets=[theirs.]"
    refused(command, *words)
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
        "dataset=hairpin method=paper +method.coarse._target_=os.system",
        "-m dataset=defaust dataset.root=. method=identity pose=all dataset.cases=os.listdir",
    ],
)
def test_a_name_on_the_command_line_needs_leave_too(theirs, arguments):
    refused(arguments, "names the function")

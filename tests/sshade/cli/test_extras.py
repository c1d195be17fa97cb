"""Commands without the libraries of the extras: they work, or name the extra to install."""

import json
import os
import subprocess
import sys
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from defaust.cli import EXTRAS as OF_DEFAUST
from eval import EXTRAS as OF_EVAL
from sshade.core.console import EXTRAS, run_command, version_of

#: A Python in which no library of an extra can be imported.
REFUSE = f"""\
import sys
class Refused:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name.partition(".")[0] in { {*EXTRAS, *OF_DEFAUST, *OF_EVAL} }:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Refused)
"""


def run(program: str, *arguments: str, code: str = "main()") -> subprocess.CompletedProcess:
    line = [sys.executable, "-c", f"{REFUSE}from {program} import main; sys.exit({code})", *arguments]
    return subprocess.run(line, capture_output=True, text=True)


@pytest.fixture(scope="module")
def example(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("example")
    assert run("defaust.cli", "example", str(folder), "--subdivisions", "0").returncode == 0
    return folder


def test_deforming_needs_no_extra_in_any_format(example):
    outputs = [str(example / f"posed.{suffix}") for suffix in ("ply", "obj", "off", "stl", "glb", "gltf")]
    files = str(example / "rest.ply"), str(example / "pose_6.json")
    lines = [["deform", *files, "-o", output, "--vertices", "400"] for output in outputs]
    done = run("sshade.cli.main", code=f"any([main(line) for line in {lines}])")
    assert done.returncode == 0 and all(map(os.path.isfile, outputs)), done.stderr


@pytest.mark.parametrize(
    ("program", "arguments", "missing"),
    [
        ("sshade.cli.main", "show {0}/rest.ply -o {0}/a.png", "pyvista is not installed; {1}figures,"),
        (
            "sshade.cli.main",
            "deform {0}/a.vtp {0}/pose_6.json -o {0}/a.ply",
            "a.vtp: pyvista is not installed; {1}figures,",
        ),
        (
            "sshade.cli.main",
            "deform {0}/rest.ply {0}/pose_6.json -o {0}/a.vtu",
            "a.vtu: pyvista is not installed; {1}figures,",
        ),
        (
            "sshade.cli.main",
            "deform {0}/rest.ply {0}/pose_6.json -o {0}/a.3mf",
            "a.3mf: trimesh is not installed; {1}formats,",
        ),
        ("sshade.cli.main", "deform {0}/rest.ply {0}/arap.yaml -o {0}/a.ply", "igl is not installed; {1}"),
        ("defaust.cli", "build out={0}/data", "hydra is not installed; {1}bench,"),
        ("eval.main", "run method=fast", "is not installed; {1}bench,"),
        ("eval.main", "collect", "pandas is not installed; {1}bench,"),
        ("eval.main", "report", "is not installed; {1}bench,"),
    ],
)
def test_the_extra_is_named_in_one_sentence(example, program, arguments, missing):
    (example / "a.vtp").write_text("any")
    for folder in ("parts", "transforms"):
        (example / folder).mkdir(exist_ok=True)
    (example / "parts" / "hand.txt").write_text("0 0 0\n1 0 0\n0 1 0\n")
    (example / "arap.yaml").write_text(json.dumps({"handles": {"static": {"positions": ["hand"]}}}))
    done = run(program, *arguments.format(example).split())
    assert done.returncode == 2 and done.stdout == "", done.stderr
    assert done.stderr.startswith("error: ") and done.stderr.count("\n") == 1
    assert missing.format("", "install the extra ") in done.stderr


def test_another_missing_module_is_an_error_of_the_program():
    with pytest.raises(ModuleNotFoundError, match="no_such_library"):
        run_command(lambda: __import__("no_such_library"))


def test_a_clone_that_is_not_installed_says_so(capsys, monkeypatch):
    def absent(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr("importlib.metadata.version", absent)
    assert run_command(lambda: version_of("sshade")) == 2
    assert capsys.readouterr().err.startswith("error: sshade is not installed; ")

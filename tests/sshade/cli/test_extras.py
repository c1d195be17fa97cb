"""Commands without the libraries of the extras: they work, or name the extra to install."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from sshade.cli.console import EXTRAS, run_command

ROOT = Path(__file__).parents[3]
#: A Python in which no library of an extra can be imported.
REFUSE = f"""\
import sys
class Refused:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name.partition(".")[0] in {set(EXTRAS)}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Refused)
"""


def run(code: str) -> subprocess.CompletedProcess:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, "-c", REFUSE + code], capture_output=True, text=True, env=environment
    )


@pytest.fixture(scope="module")
def example(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("example")
    line = ["example", str(folder), "--subdivisions", "0"]
    assert run(f"from defaust.cli import main; sys.exit(main({line}))").returncode == 0
    return folder


def test_deforming_needs_no_extra_in_any_format(example):
    outputs = [str(example / f"posed.{suffix}") for suffix in ("ply", "obj", "off", "stl", "glb", "gltf")]
    files = str(example / "rest.ply"), str(example / "pose_6.json")
    lines = [["deform", *files, "-o", output, "--vertices", "400"] for output in outputs]
    done = run(f"from sshade.cli.main import main; sys.exit(any([main(line) for line in {lines}]))")
    assert done.returncode == 0 and all(map(os.path.isfile, outputs)), done.stderr


#: Command lines, and words of their refusals.
REFUSED = {
    "sshade show {0}/rest.ply -o {0}/a.png": "pyvista is not installed; install the extra figures,",
    "sshade deform {0}/rest.ply {0}/arap.yaml -o {0}/a.ply": "igl is not installed; install the extra ",
    "defaust build out={0}/data": "hydra is not installed; install the extra bench,",
    "eval run method=fast": "is not installed; install the extra bench,",
    "eval collect": "pandas is not installed; install the extra bench,",
    "eval report": "is not installed; install the extra bench,",
}


def test_the_extra_is_named_in_one_sentence(example):
    for folder in ("parts", "transforms"):
        (example / folder).mkdir()
    (example / "parts" / "hand.txt").write_text("0 0 0\n1 0 0\n0 1 0\n")
    (example / "arap.yaml").write_text(json.dumps({"handles": {"static": {"positions": ["hand"]}}}))
    lines = [line.format(example).split() for line in REFUSED]
    done = run(f"""\
from importlib import import_module
mains = {{"sshade": "sshade.cli.main", "defaust": "defaust.cli", "eval": "eval.main"}}
sys.exit(sum(import_module(mains[name]).main(line) != 2 for name, *line in {lines}))
""")
    assert done.returncode == 0 and done.stdout == "", done.stderr
    for said, words in zip(done.stderr.splitlines(), REFUSED.values(), strict=True):
        assert said.startswith("error: ") and words in said


def test_another_missing_module_is_an_error_of_the_program():
    with pytest.raises(ModuleNotFoundError, match="no_such_library"):
        run_command(lambda: __import__("no_such_library"))

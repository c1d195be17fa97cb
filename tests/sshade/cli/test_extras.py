"""Commands without the libraries of the extras: they work, or name the extra to install."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from defaust.cli import EXTRAS as OF_DEFAUST
from eval import EXTRAS as OF_EVAL
from sshade.core.console import EXTRAS

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


def test_deforming_needs_no_extra_in_any_format(sound):
    outputs = [f"posed.{suffix}" for suffix in ("ply", "obj", "off", "stl", "glb", "gltf")]
    lines = [["deform", "body.ply", "pose.json", "-o", output, "--vertices", "60"] for output in outputs]
    done = run("sshade.cli.main", code=f"any([main(line) for line in {lines}])")
    assert done.returncode == 0 and all(map(os.path.isfile, outputs)), done.stderr


#: Command lines and words of their errors, by program.
MISSING = {
    "sshade.cli.main": {
        "show body.ply -o a.png": "pyvista is not installed; install the extra figures,",
        "deform a.vtp pose.json -o a.ply": "a.vtp: pyvista is not installed; install the extra figures,",
        "deform body.ply pose.json -o a.vtu": "a.vtu: pyvista is not installed; install the extra figures,",
        "deform body.ply pose.json -o a.3mf": "a.3mf: trimesh is not installed; install the extra formats,",
        "deform body.ply arap.yaml -o a.ply": "igl is not installed; install the extra ",
    },
    "defaust.cli": {"build out=data": "hydra is not installed; install the extra bench,"},
    "eval.main": {
        "run method=fast": "is not installed; install the extra bench,",
        "collect": "pandas is not installed; install the extra bench,",
        "report": "is not installed; install the extra bench,",
    },
}


@pytest.mark.parametrize("program", MISSING)
def test_the_extra_is_named_in_one_sentence(sound, program):
    Path("a.vtp").write_text("any")
    for folder in ("parts", "transforms"):
        Path(folder).mkdir(exist_ok=True)
    Path("parts/hand.txt").write_text("0 0 0\n1 0 0\n0 1 0\n")
    Path("arap.yaml").write_text(json.dumps({"handles": {"static": {"positions": ["hand"]}}}))
    lines = [line.split() for line in MISSING[program]]
    done = run(program, code=f"[main(line) for line in {lines}] != {[2] * len(lines)}")
    assert done.returncode == 0 and done.stdout == "", done.stderr
    for error, words in zip(done.stderr.splitlines(), MISSING[program].values(), strict=True):
        assert error.startswith("error: ") and words in error

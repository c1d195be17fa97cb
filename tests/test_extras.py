"""Each package knows the extras of the libraries that it imports, and of no others."""

import ast
import sys
import tomllib
from pathlib import Path

import pytest

from defaust.cli import EXTRAS as OF_DEFAUST
from eval import EXTRAS as OF_EVAL
from sshade.core.console import EXTRAS as OF_SSHADE

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OWN = {"sshade", "baselines", "defaust", "eval"}
#: Modules of the required libraries, of numba's compiler, and of Blender, which runs the extension.
REQUIRED = {"numpy", "scipy", "numba", "yaml", "rich", "psutil", "llvmlite", "bpy", "bmesh", "mathutils"}


def imported(*packages):
    """Return the libraries that packages import, also inside of functions, without the required ones."""
    found = set()
    for path in (path for package in packages for path in (ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                found.add(node.module.partition(".")[0])
            elif isinstance(node, ast.Call) and ast.unparse(node.func) == "ModuleNotFoundError":
                found |= {word.value.value for word in node.keywords if word.arg == "name"}
    return found - set(sys.stdlib_module_names) - OWN - REQUIRED


@pytest.mark.parametrize(
    ("extras", "packages"),
    [(OF_SSHADE, ["sshade"]), (OF_DEFAUST, ["defaust"]), (OF_EVAL | OF_SSHADE, sorted(OWN))],
    ids=["sshade", "defaust", "eval"],
)
def test_each_imported_library_has_its_extra(extras, packages):
    assert set(extras) == imported(*packages)
    assert set(extras.values()) <= set(PROJECT["optional-dependencies"])

"""Nothing that is read is executed: the packages call no loader that could."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = [
    p for name in ("sshade", "baselines", "defaust", "eval") for p in sorted((ROOT / name).rglob("*.py"))
]

#: Modules that turn bytes into objects or text into code.
MODULES = {"pickle", "cPickle", "dill", "joblib", "marshal", "shelve", "jsonpickle"}
#: Calls that execute text, or unpickle, whatever their arguments.
CALLS = {"eval", "exec", "compile", "os.system", "os.popen", "runpy.run_path"}
CALLS |= {"yaml.load", "yaml.unsafe_load", "yaml.full_load"}
CALLS |= {"torch.load", "pandas.read_pickle", "pd.read_pickle", "np.loads"}


def dangers(source: str) -> list[str]:
    """What a source should not do, with the line."""
    found = []
    for node in ast.walk(ast.parse(source)):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name.split(".")[0] for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names = [node.module.split(".")[0]]
        found += [f"{node.lineno}: import {name}" for name in names if name in MODULES]
        if not isinstance(node, ast.Call):
            continue
        name = ast.unparse(node.func)
        keywords = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
        if name in CALLS or name.endswith("extractall"):
            found.append(f"{node.lineno}: {name}()")
        if keywords.get("allow_pickle", "False") != "False" or keywords.get("shell", "False") != "False":
            found.append(f"{node.lineno}: {name}({keywords})")
        if name == "np.load" and "allow_pickle" not in keywords:
            found.append(f"{node.lineno}: np.load without allow_pickle=False")
    return found


def test_no_module_executes_what_it_reads():
    assert len(SOURCES) > 60
    found = {str(path): dangers(path.read_text(encoding="utf-8")) for path in SOURCES}
    assert {path: what for path, what in found.items() if what} == {}


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "from joblib import load",
        "exec(text)",
        "import yaml\nyaml.load(text, Loader=yaml.Loader)",
        "np.load(path)",
        "np.load(path, allow_pickle=True)",
        "subprocess.run(text, shell=True)",
        "archive.extractall(folder)",
        "torch.load(path)",
    ],
)
def test_the_scan_finds(source):
    assert dangers(source)

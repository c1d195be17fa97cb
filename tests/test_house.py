"""The house: names, arguments by name, extras, versions, and what compiled functions may use.

The store of machine code checks only the source file of the kernel itself. After an edit of another file
alone, users would keep the old machine code. So no compiled function uses a compiled function or a constant
of another file.
"""

import ast
import doctest
import importlib
import pkgutil
import re
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from pkgutil import resolve_name
from types import ModuleType

import pytest
from numba.core.registry import CPUDispatcher

import sshade
from defaust.cli import EXTRAS as OF_DEFAUST
from eval import EXTRAS as OF_EVAL
from sshade.core.console import EXTRAS as OF_SSHADE

ROOT = Path(__file__).parents[1]
PACKAGES = ("sshade", "baselines", "defaust", "eval")
TEXTS = {
    path.relative_to(ROOT): path.read_text(encoding="utf-8")
    for package in PACKAGES
    for path in sorted((ROOT / package).rglob("*.py"))
}
TREES = {path: ast.parse(text) for path, text in TEXTS.items()}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def types_of(node: ast.stmt) -> list[str]:
    """Return the class or the aliases of types that a statement of a module names."""
    if isinstance(node, ast.ClassDef):
        return [node.name]
    names = [target.id for target in getattr(node, "targets", ()) if isinstance(target, ast.Name)]
    return [name for name in names if name[0].isupper() and not name.isupper()]


def test_no_name_of_a_type_occurs_twice():
    names = Counter(name for tree in TREES.values() for node in tree.body for name in types_of(node))
    assert [name for name, count in names.items() if count > 1] == []
    assert len(names) > 200 and {"Bound", "Deformer", "HandleKind"} <= {*names}


@cache
def exists(dotted: str) -> bool:
    """Whether there is such a module, or such a name in one; or an attribute that a class documents."""
    try:
        resolve_name(dotted)
    except (ImportError, AttributeError):
        path, _, name = dotted.rpartition(".")
        try:
            text = resolve_name(path).__doc__ or ""
        except (ImportError, AttributeError):
            return False
        return bool(re.search(rf"^ *(\w+, )*{name}\b.* : ", text, re.MULTILINE))
    return True


def test_references_in_docstrings_and_comments_exist():
    found = [
        (str(path), name)
        for path, text in TEXTS.items()
        for name in re.findall(r":[a-z]+:`~?([\w.]+)`", text)
        if name.split(".")[0] in PACKAGES
    ]
    assert [pair for pair in found if not exists(pair[1])] == [] and len(found) > 150


#: Readers of files, which other programs call; names that Blender and the program of sub-commands look up.
FOR_OTHERS = {"read_handles", "read_mesh", "read_arrays", "read_task"}
FOR_OTHERS |= {"add_arguments", "command", "register", "unregister"}
SSHADE = [path for path in TREES if path.parts[0] == "sshade"]


def names_used(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
            yield node.attr
        elif isinstance(node, ast.alias):
            yield node.name


USED = {name for path in SSHADE for name in names_used(TREES[path])}


def public_names(body: list[ast.stmt]) -> Iterator[str]:
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            yield from (target.id for target in targets if isinstance(target, ast.Name))


@pytest.mark.parametrize("path", SSHADE, ids=str)
def test_each_public_name_of_a_module_is_used_in_sshade(path):
    names = {name for name in public_names(TREES[path].body) if not name.startswith("_")}
    assert names <= USED | FOR_OTHERS | set(sshade.__all__)


def test_no_other_package_or_script_imports_the_commands():
    folders = ("baselines", "defaust", "docs", "eval", "tools")
    for path in (path for folder in folders for path in (ROOT / folder).rglob("*.py")):
        assert "sshade.cli" not in path.read_text(encoding="utf-8"), path


#: Modules of the required libraries, of numba's compiler, and of Blender, which runs the extension.
REQUIRED = {"numpy", "scipy", "numba", "yaml", "rich", "psutil", "llvmlite", "bpy", "bmesh", "mathutils"}


def imported(*packages):
    """Return the libraries that packages import, also inside of functions, without the required ones."""
    found = set()
    for node in (n for path, tree in TREES.items() if path.parts[0] in packages for n in ast.walk(tree)):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add(node.module.partition(".")[0])
        elif isinstance(node, ast.Call) and ast.unparse(node.func) == "ModuleNotFoundError":
            found |= {word.value.value for word in node.keywords if word.arg == "name"}
    return found - set(sys.stdlib_module_names) - {*PACKAGES} - REQUIRED


@pytest.mark.parametrize(
    ("extras", "packages"),
    [(OF_SSHADE, ["sshade"]), (OF_DEFAUST, ["defaust"]), (OF_EVAL | OF_SSHADE, PACKAGES)],
    ids=["sshade", "defaust", "eval"],
)
def test_each_imported_library_has_its_extra(extras, packages):
    assert set(extras) == imported(*packages)
    assert set(extras.values()) <= set(PROJECT["optional-dependencies"])


def test_files_of_a_release_name_one_version():
    for name, pattern in {"CITATION.cff": r"^version: (\S+)$", "CHANGELOG.md": r"^## ([^,\s]+)"}.items():
        found = re.search(pattern, (ROOT / name).read_text("utf-8"), re.MULTILINE)
        assert found[1] == PROJECT["version"], name


def modules_with_kernels() -> dict[ModuleType, list[CPUDispatcher]]:
    """Return each module with the compiled functions that it defines, under any name."""
    found = {}
    for path in (path for path, text in TEXTS.items() if "sshade.core.kernels import" in text):
        name = ".".join(path.with_suffix("").parts).removesuffix(".__init__")
        module = importlib.import_module(name)
        own = [value for value in vars(module).values() if isinstance(value, CPUDispatcher)]
        found[module] = [kernel for kernel in own if kernel.py_func.__module__ == name]
    return found


def test_no_kernel_calls_one_of_another_file_also_through_re_exports():
    modules = modules_with_kernels()
    assert sum(map(len, modules.values())) > 50
    for module, kernels in modules.items():
        for kernel in kernels:
            names, scope = kernel.py_func.__code__.co_names, kernel.py_func.__globals__
            used = [scope[name] for name in names if name in scope]
            used += [vars(m).get(name) for m in used if isinstance(m, ModuleType) for name in names]
            others = {value.py_func.__module__ for value in used if isinstance(value, CPUDispatcher)}
            assert others <= {module.__name__}, kernel


def test_constants_of_kernels_are_assigned_in_their_own_file():
    for module, kernels in modules_with_kernels().items():
        tree = TREES[Path(str(module.__file__)).relative_to(ROOT)]
        stored = [node for node in ast.walk(tree) if isinstance(getattr(node, "ctx", None), ast.Store)]
        assigned = {node.id for node in stored if isinstance(node, ast.Name)}
        for kernel in kernels:
            scope, names = kernel.py_func.__globals__, kernel.py_func.__code__.co_names
            used = {name for name in names if isinstance(scope.get(name), int | float | tuple)}
            assert used <= assigned, kernel


HEAVY = ["pymeshlab", "pandas", "hydra", "omegaconf", "torch", "pyvista", "matplotlib", "trimesh", "rich"]
MODULES = ["sshade", *(info.name for info in pkgutil.walk_packages(sshade.__path__, "sshade."))]


@pytest.mark.parametrize("program", ["sshade.cli.main", "defaust.cli", "eval.main"])
def test_help_imports_no_library(program):
    code = f"import sys, {program} as p\ntry: p.main(['--help'])\nfinally: print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    *text, modules = run.stdout.splitlines()
    assert run.returncode == 0 and len(text) > 5
    assert not {"numpy", "scipy", "numba", "yaml", *HEAVY, *OF_EVAL} & set(modules.split())


def test_names_of_the_package_are_found_when_they_are_asked_for():
    assert set(sshade.__all__) == set(sshade._HOME) <= set(dir(sshade))
    assert set(dir(sshade)) == {*sshade.__all__, "__version__"}
    for name in sshade.__all__:
        value = getattr(sshade, name)
        assert value.__name__ == {"Deformer": "Bound"}.get(name, name)
    with pytest.raises(AttributeError, match="no attribute 'shade'"):
        sshade.shade  # noqa: B018


@pytest.mark.parametrize("name", [name for name in MODULES if not re.search(r"__main__$|blender\.", name)])
def test_examples_in_docstrings_do_what_they_show(name):
    assert doctest.testmod(importlib.import_module(name)).failed == 0

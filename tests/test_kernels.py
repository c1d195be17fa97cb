"""No compiled function calls a compiled function of another file.

numba's disk cache knows the source of the file that it compiles, and of no other: after
an edit of the callee alone, users would go on with the old machine code of the caller.
"""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("sshade", "baselines", "defaust", "eval")
COMPILERS = {"njit", "jit", "vectorize", "guvectorize", "stencil", "cfunc"}


def sources(root: Path) -> dict[str, ast.Module]:
    """Syntax trees of the packages' modules by their dotted names."""
    found = {}
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            found[name] = ast.parse(path.read_text(encoding="utf-8"))
    return found


def is_compiled(function: ast.AST) -> bool:
    """Whether a decorator names one of numba's compilers, with arguments or without."""
    if not isinstance(function, ast.FunctionDef):
        return False
    makers = [d.func if isinstance(d, ast.Call) else d for d in function.decorator_list]
    return any(getattr(m, "id", getattr(m, "attr", None)) in COMPILERS for m in makers)


def compiled(tree: ast.Module) -> set[str]:
    """Names that a module gives to compiled functions: decorated ones, and ``name = njit(...)(function)``."""
    names = {node.name for node in ast.walk(tree) if is_compiled(node)}
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call):
            calls = [c.func for c in ast.walk(node.value) if isinstance(c, ast.Call)]
            if any(getattr(c, "id", getattr(c, "attr", None)) in COMPILERS for c in calls):
                names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
    return names


def calls_across(trees: dict[str, ast.Module]) -> list[str]:
    """Each use of another module's compiled function within a compiled function, also through re-exports."""
    kernels = {(module, name) for module, tree in trees.items() for name in compiled(tree)}
    imported: dict[str, dict[str, tuple[str, str]]] = {}
    for module, tree in trees.items():
        imported[module] = {
            alias.asname or alias.name: (node.module, alias.name)
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and node.module
            for alias in node.names
        } | {
            alias.asname: tuple(alias.name.rsplit(".", 1))
            for node in ast.walk(tree)
            if isinstance(node, ast.Import)
            for alias in node.names
            if alias.asname and "." in alias.name
        }

    def origin(module: str, name: str) -> tuple[str, str]:
        while name in imported.get(module, {}):
            module, name = imported[module][name]
        return module, name

    found = []
    for module, tree in trees.items():
        for function in filter(is_compiled, ast.walk(tree)):
            for node in ast.walk(function):
                if isinstance(node, ast.Name) and node.id in imported[module]:
                    target = origin(module, node.id)
                elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                    package, name = imported[module].get(node.value.id, ("", ""))
                    target = origin(f"{package}.{name}", node.attr)
                else:
                    continue
                if target in kernels and target[0] != module:
                    found.append(f"{module}.{function.name} -> {'.'.join(target)}")
    return found


def test_no_kernel_calls_one_of_another_file():
    trees = sources(ROOT)
    assert sum(len(compiled(tree)) for tree in trees.values()) > 50
    assert calls_across(trees) == []


@pytest.mark.parametrize(
    "caller",
    [
        "from sshade.a import inner\n@njit(cache=True)\ndef outer(x):\n    return inner(x)\n",
        "from sshade.a import inner as other\n@numba.njit\ndef outer(x):\n    return other(x)\n",
        "from sshade import a\n@njit\ndef outer(x):\n    return a.inner(x)\n",
        "import sshade.a as a\n@njit\ndef outer(x):\n    return a.inner(x)\n",
        "from sshade.again import inner\n@njit\ndef outer(x):\n    return inner(x)\n",
    ],
)
def test_such_calls_are_found(tmp_path, caller):
    folder = tmp_path / "sshade"
    folder.mkdir()
    (folder / "a.py").write_text("@njit(cache=True, nogil=True)\ndef inner(x):\n    return x\n")
    (folder / "again.py").write_text("from sshade.a import inner\n")
    (folder / "b.py").write_text(caller)
    assert calls_across(sources(tmp_path)) == ["sshade.b.outer -> sshade.a.inner"]

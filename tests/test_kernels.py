"""No compiled function uses a compiled function or a constant of another file.

The store of machine code checks only the source file of the kernel itself. After an edit of another file
alone, users would keep the old machine code.
"""

import ast
import importlib
from pathlib import Path
from types import ModuleType

from numba.core.registry import CPUDispatcher

ROOT = Path(__file__).parents[1]
PACKAGES = ("sshade", "baselines", "defaust", "eval")
SOURCES = [path for name in PACKAGES for path in sorted((ROOT / name).rglob("*.py"))]


def kernels(module: ModuleType) -> list[CPUDispatcher]:
    """Return the compiled functions that a module defines, under any name."""
    named = [value for value in vars(module).values() if isinstance(value, CPUDispatcher)]
    return [kernel for kernel in named if kernel.py_func.__module__ == module.__name__]


def calls_across(module: ModuleType) -> list[str]:
    """List the uses of other modules' compiled functions in compiled functions, also through re-exports."""
    found = []
    for kernel in kernels(module):
        names, scope = kernel.py_func.__code__.co_names, kernel.py_func.__globals__
        used = [scope[name] for name in names if name in scope]
        used += [vars(m).get(name) for m in used if isinstance(m, ModuleType) for name in names]
        for callee in (value.py_func for value in used if isinstance(value, CPUDispatcher)):
            if callee.__module__ != module.__name__:
                caller = f"{module.__name__}.{kernel.py_func.__name__}"
                found.append(f"{caller} -> {callee.__module__}.{callee.__name__}")
    return found


def modules_with_kernels() -> list[ModuleType]:
    compiled = [path for path in SOURCES if "sshade.core.kernels import" in path.read_text(encoding="utf-8")]
    names = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in compiled]
    return [importlib.import_module(name.removesuffix(".__init__")) for name in names]


def test_no_kernel_calls_one_of_another_file():
    modules = modules_with_kernels()
    assert sum(len(kernels(module)) for module in modules) > 50
    assert [call for module in modules for call in calls_across(module)] == []


def test_constants_of_kernels_are_assigned_in_their_own_file():
    for module in modules_with_kernels():
        tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))
        stored = [node for node in ast.walk(tree) if isinstance(getattr(node, "ctx", None), ast.Store)]
        assigned = {node.id for node in stored if isinstance(node, ast.Name)}
        for kernel in kernels(module):
            scope, names = kernel.py_func.__globals__, kernel.py_func.__code__.co_names
            used = {name for name in names if isinstance(scope.get(name), int | float | tuple)}
            assert used <= assigned, kernel

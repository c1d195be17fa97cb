"""Every public name of sshade has a use in sshade, and no other package imports the commands of sshade."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import sshade

ROOT = Path(__file__).parents[1]
SOURCES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in (ROOT / "sshade").rglob("*.py")}
#: Readers of files, which other programs call.
FOR_OTHERS = {"read_handles", "read_mesh", "read_arrays", "read_task"}
#: Names that Blender and the program of sub-commands look up.
LOOKED_UP = {"add_arguments", "command", "register", "unregister"}


def names_used(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
            yield node.attr
        elif isinstance(node, ast.alias):
            yield node.name


USED = {name for tree in SOURCES.values() for name in names_used(tree)}


def public_names(body: list[ast.stmt]) -> Iterator[str]:
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            yield from (target.id for target in targets if isinstance(target, ast.Name))


@pytest.mark.parametrize("path", sorted(SOURCES), ids=lambda path: path.relative_to(ROOT).as_posix())
def test_each_public_name_of_a_module_is_used_in_sshade(path):
    names = {name for name in public_names(SOURCES[path].body) if not name.startswith("_")}
    assert names <= USED | LOOKED_UP | FOR_OTHERS | set(sshade.__all__)


def test_no_other_package_or_script_imports_the_commands():
    folders = ("baselines", "defaust", "docs", "eval", "tools")
    for path in (path for folder in folders for path in (ROOT / folder).rglob("*.py")):
        assert "sshade.cli" not in path.read_text(encoding="utf-8"), path

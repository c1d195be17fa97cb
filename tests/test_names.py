"""One name for one thing: classes in the four packages, and modules within a package."""

import ast
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
OURS = ("sshade", "baselines", "defaust", "eval")
SOURCES = [path for name in OURS for path in (ROOT / name).rglob("*.py")]


def test_no_class_name_occurs_twice():
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in SOURCES]
    names = Counter(node.name for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef))
    assert [name for name, count in names.items() if count > 1] == [] and len(names) > 100


def test_no_module_name_occurs_twice_in_a_package():
    """Modules of sub-commands have the names of their sub-commands."""
    paths = [path.relative_to(ROOT) for path in SOURCES if path.parent.name != "cli"]
    names = Counter((path.parts[0], path.stem) for path in paths if not path.stem.startswith("__"))
    assert [name for name, count in names.items() if count > 1] == []

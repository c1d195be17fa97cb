"""One name for one thing: types in the four packages, modules within a package, options of the methods."""

import ast
import re
from collections import Counter
from functools import cache
from pathlib import Path
from pkgutil import resolve_name

ROOT = Path(__file__).parents[1]
OURS = ("sshade", "baselines", "defaust", "eval")
SOURCES = [path for name in OURS for path in (ROOT / name).rglob("*.py")]


def types_of(node: ast.stmt) -> list[str]:
    """Return the class or the aliases of types that a statement of a module names."""
    if isinstance(node, ast.ClassDef):
        return [node.name]
    names = [target.id for target in getattr(node, "targets", ()) if isinstance(target, ast.Name)]
    return [name for name in names if name[0].isupper() and not name.isupper()]


def test_no_name_of_a_type_occurs_twice():
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in SOURCES]
    names = Counter(name for tree in trees for node in tree.body for name in types_of(node))
    assert [name for name, count in names.items() if count > 1] == []
    assert len(names) > 200 and {"Bound", "Deformer", "HandleKind"} <= {*names}


def test_no_module_name_occurs_twice_in_a_package():
    """Modules of sub-commands have the names of their sub-commands."""
    paths = [path.relative_to(ROOT) for path in SOURCES if path.parent.name != "cli"]
    names = Counter((path.parts[0], path.stem) for path in paths if not path.stem.startswith("__"))
    assert [name for name, count in names.items() if count > 1] == []


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
        (str(path.relative_to(ROOT)), name)
        for path in SOURCES
        for name in re.findall(r":[a-z]+:`~?([\w.]+)`", path.read_text(encoding="utf-8"))
        if name.split(".")[0] in OURS
    ]
    assert [pair for pair in found if not exists(pair[1])] == [] and len(found) > 150

"""The version of the code behind a row: a hash of the parsed modules that can change its numbers.

A row depends on the functions that its configuration names, and on all modules that they import,
directly or through others, imports inside functions included. Docstrings, comments and formatting are
no part of the hash. The files of an external program count byte by byte. Libraries count by their version
numbers instead (:mod:`eval.run.provenance`).
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from eval.installation import PACKAGES
from eval.run.targets import search_here
from sshade.core.errors import InputError

#: The project's packages. Methods from all other packages belong to users.
OWN = frozenset({"sshade", "baselines", "defaust", "eval"})
#: Types of the tasks and results, which every row depends on.
TYPES = "sshade.problem.task"
#: Modules that call a method and read its clock. Every row depends on their text, not on their imports.
RUNNER = ("eval/run/attempt.py", "eval/run/targets.py")


class CodeChanged(InputError):
    """The code differs from the code that the command began with; no further run can use it."""


class SourceFile(NamedTuple):
    """A parsed Python file.

    Attributes
    ----------
    path : Path
    place : str
        Path relative to the folder of the top-level package. For a file of a program, ``program:`` or
        ``file:`` and its name in the configuration.
    stamp : tuple
        Time of the last write and size.
    hash : str
        16 hex digits of the code.
    imports : frozenset of str
        Dotted names of the imported modules and of the names imported from modules.
    lazy : mapping or None
        For a package with a function ``__getattr__``: public name -> dotted name, from the imports that the
        package shows to type checkers. None for all other modules.
    """

    path: Path
    place: str
    stamp: tuple[int, int]
    hash: str
    imports: frozenset[str]
    lazy: Mapping[str, str] | None


def digest(*parts: bytes) -> str:
    """Return 16 hex digits of the SHA-256 of the parts, each preceded by its length."""
    sha = hashlib.sha256()
    for part in parts:
        sha.update(len(part).to_bytes(8, "little"))
        sha.update(part)
    return sha.hexdigest()[:16]


def loaded_code(functions: Iterable[str]) -> dict[str, str]:
    """Return the hash of each file that the rows of some functions depend on, and of the metrics.

    Keys are paths of files, relative to the folder of their top-level package.

    Parameters
    ----------
    functions : iterable of str
        Names as :func:`eval.run.targets.code_of` gives them.
    """
    return {place: file.hash for place, file in (_files(frozenset(functions)) | MEASURES).items()}


def code_version(functions: Iterable[str]) -> str:
    """Return one hash of all files that the rows of some functions depend on, without the metrics."""
    return _version(_files(frozenset(functions)))


def imported_libraries(functions: Iterable[str]) -> set[str]:
    """Return the top-level names of all modules that the code of some functions imports."""
    files = _files(frozenset(functions)).values()
    return {name.partition(".")[0] for file in files for name in file.imports}


def require_unchanged(functions: Iterable[str], *, begun_with: Mapping[str, str] | None = None) -> None:
    """Check that the code on disk, which Python may import at any time, is still the code that was hashed.

    Parameters
    ----------
    functions : iterable of str
        Names as :func:`eval.run.targets.code_of` gives them.
    begun_with : mapping, optional
        :func:`loaded_code` of the process that started this one.

    Raises
    ------
    CodeChanged
        When a file's code changed or a file was removed, or when the two processes loaded different code.
    """
    files = _files(frozenset(functions)) | MEASURES
    changed = [place for place, file in files.items() if _changed(file)]
    if begun_with is not None:
        own = loaded_code(functions)
        changed += [place for place in own if own[place] != begun_with.get(place)]
    if changed:
        raise _code_changed(changed[0])


def _code_changed(place: str) -> CodeChanged:
    return CodeChanged(
        f"{place} has changed since the command began, so its runs would mix two versions of the code; "
        "start the command again: finished rows stay"
    )


def _version(files: Mapping[str, SourceFile]) -> str:
    return digest(*(text.encode() for place in sorted(files) for text in (place, files[place].hash)))


def _stamp(path: Path) -> tuple[int, int]:
    stat = path.stat()
    return stat.st_mtime_ns, stat.st_size


def _changed(file: SourceFile) -> bool:
    """Whether the code of a file differs from its hash; new docstrings and comments are no change."""
    read = _read_bytes if ":" in file.place else _read
    try:
        return _stamp(file.path) != file.stamp and read(file.path, file.place).hash != file.hash
    except OSError:
        return True


#: Stamps of the project's files when this process began; a file must still have its stamp when it is parsed.
_BEGUN = {path: _stamp(path) for top in OWN for path in (PACKAGES / top).rglob("*.py")}


@cache
def _parsed(path: Path, root: Path) -> SourceFile:
    """Parse a file once for the process. `root` is the folder of the top-level package.

    Raises
    ------
    CodeChanged
        When one of the project's files was written since this process began.
    """
    file = _read(path, path.relative_to(root).as_posix())
    if _BEGUN.get(path, file.stamp) != file.stamp:
        raise _code_changed(file.place)
    return file


def _read(path: Path, place: str) -> SourceFile:
    stamp, text = _stamp(path), path.read_bytes()
    package = place.rpartition("/")[0].replace("/", ".")  # relative imports start there
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError):  # the file cannot be imported
        return SourceFile(path, place, stamp, digest(text), frozenset(), None)
    functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    is_lazy = path.name == "__init__.py" and "__getattr__" in functions
    lazy = dict(_imports(tree, package, typing=True)) if is_lazy else None
    imports = frozenset(name for _, name in _imports(tree, package)) | _attributes(tree)
    return SourceFile(path, place, stamp, digest(repr(_plain(tree)).encode()), imports, lazy)


def _read_bytes(path: Path, place: str) -> SourceFile:
    """Read a file of a program. `place` begins with ``program:`` or ``file:``."""
    stamp = _stamp(path)
    with path.open("rb") as stream:
        sha = hashlib.file_digest(stream, "sha256")
    return SourceFile(path, place, stamp, sha.hexdigest()[:16], frozenset(), None)


@cache
def _of_program(name: str) -> tuple[SourceFile, ...]:
    """Return the files that ``program:NAME`` or ``file:PATH`` stands for, of a folder without hidden files.

    Raises
    ------
    InputError
        When there is no such file.
    """
    kind, _, word = name.partition(":")
    found = shutil.which(word) if kind == "program" else word
    if found is None or not Path(found).exists():
        raise InputError(f"there is no {kind} {word!r}; relative paths begin at {Path.cwd()}")
    path = Path(found).absolute()
    if path.is_file():
        return (_read_bytes(path, name),)
    inside = {one.relative_to(path): one for one in sorted(path.rglob("*")) if one.is_file()}
    hidden = [place for place in inside if any(part.startswith((".", "__pycache__")) for part in place.parts)]
    names = inside.keys() - hidden
    return tuple(_read_bytes(inside[place], f"{name}/{place.as_posix()}") for place in sorted(names))


def _imports(node: ast.AST, package: str, *, typing: bool = False) -> Iterator[tuple[str, str]]:
    """Yield each imported name and its dotted name; imports for type checkers alone only with `typing`."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import):
            yield from ((alias.asname or alias.name, alias.name) for alias in child.names)
        elif isinstance(child, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) + 1 - child.level] if child.level else []
            module = ".".join(filter(None, [*above, child.module]))
            yield from ((alias.asname or alias.name, f"{module}.{alias.name}") for alias in child.names)
        elif isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test) and not typing:
            yield from _imports(ast.Module(child.orelse, []), package)
        elif not isinstance(child, ast.expr):
            yield from _imports(child, package, typing=typing)


def _attributes(tree: ast.Module) -> set[str]:
    """Dotted names of attributes of the project's packages, as in ``import sshade; sshade.deform``."""
    imports = [alias for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    bound = {alias.asname or alias.name: alias.name for alias in imports if alias.name.split(".")[0] in OWN}
    nodes = ast.walk(tree) if bound else ()
    return {
        f"{bound[node.value.id]}.{node.attr}"
        for node in nodes
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in bound
    }


def _plain(node: Any) -> Any:
    """Return a syntax tree as nested tuples, without places, docstrings and fields that are empty.

    `ast.dump` would be slower, and writes empty fields in some versions of Python only.
    """
    if isinstance(node, ast.AST):
        fields = ((name, getattr(node, name, None)) for name in node._fields)
        filled = ((name, _plain(value)) for name, value in fields if value not in (None, []))
        return type(node).__name__, *filled
    if isinstance(node, list):
        return [_plain(item) for item in node if not _is_text(item)]
    return node


def _is_text(node: Any) -> bool:
    """Whether a statement is a docstring or another string that has no effect."""
    value = getattr(node, "value", None) if isinstance(node, ast.Expr) else None
    return isinstance(value, ast.Constant) and isinstance(value.value, str)


@cache
def _files(functions: frozenset[str]) -> dict[str, SourceFile]:
    """The files that the rows of some functions depend on, by place."""
    files = {place: _parsed(PACKAGES / place, PACKAGES) for place in RUNNER}
    programs = {name for name in functions if ":" in name}
    files |= {file.place: file for name in programs for file in _of_program(name)}
    functions -= programs
    waiting, seen = {TYPES, *functions}, set[str]()
    for top in {name.partition(".")[0] for name in functions} - OWN:  # all files of a user's package
        for root in places(top):
            for path in root.rglob("*.py") if root.is_dir() else [root]:
                file = _parsed(path, root.parent)
                files[file.place] = file
                waiting |= file.imports
    while waiting:
        name = waiting.pop()
        seen.add(name)
        for file in _loaded_by(name):
            if file.place not in files:
                files[file.place] = file
                waiting |= file.imports - seen
    return files


def _loaded_by(name: str) -> Iterator[SourceFile]:
    """Yield the file of each module that an import of a dotted name loads, packages first.

    A package with lazy names does not count; the module that defines the name does.
    """
    parts = name.split(".")
    if parts[0] not in OWN and (parts[0] in sys.stdlib_module_names or _is_installed(parts[0])):
        return
    for root in places(parts[0]):
        for end in range(1, len(parts) + 1):
            path = _module(root, parts[1:end])
            if path is None:
                continue
            file = _parsed(path, root.parent)
            if file.lazy is None:
                yield file
            elif end < len(parts) and _module(root, parts[1 : end + 1]) is None:
                names = file.lazy if parts[end] == "*" else {parts[end]} & file.lazy.keys()
                for attribute in names:
                    yield from _loaded_by(file.lazy[attribute])


def _module(root: Path, parts: list[str]) -> Path | None:
    """The file of a module of the package `root`, or of the single module `root` itself."""
    if root.is_file():
        return None if parts else root
    folder = root.joinpath(*parts)
    candidates = [folder / "__init__.py"]
    if parts:
        candidates.append(folder.with_name(f"{parts[-1]}.py"))
    return next((path for path in candidates if path.is_file()), None)


@cache
def places(top: str) -> tuple[Path, ...]:
    """Return the Python file of a top-level module or the folders of a package; empty if it is not found."""
    search_here()
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError):  # ValueError: a module without a spec, such as __main__
        return ()
    if spec is None:
        return ()
    if spec.submodule_search_locations:
        return tuple(Path(folder) for folder in spec.submodule_search_locations)
    return (Path(spec.origin),) if spec.origin and spec.origin.endswith(".py") else ()


def _is_installed(top: str) -> bool:
    """Whether a module is part of an installed library."""
    return any({"site-packages", "dist-packages"} & {*path.parts} for path in places(top))


#: Files of the metrics, by place, and their version, the column ``env.version.metrics``.
_OF_METRICS = sorted((PACKAGES / "eval" / "metrics").rglob("*.py"))
MEASURES = {file.place: file for file in (_parsed(path, PACKAGES) for path in _OF_METRICS)}
METRICS = _version(MEASURES)

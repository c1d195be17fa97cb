"""Where a row comes from: machine, versions, commit, and the hashes that make its key."""

from __future__ import annotations

import ast
import hashlib
import importlib.metadata
import importlib.util
import json
import os
import platform
import re
import site
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eval.run.targets import search_here
from sshade.cli.configuration import PACKAGES
from sshade.errors import InputError
from sshade.task import DeformationTask, TransferTask
from sshade.threads import available_cpus

#: Folders of the code that can change the numbers of a row.
CODE = ("sshade", "baselines", "defaust", "eval/configure", "eval/run")
#: What of it shows results to people; no method imports these.
SHOWN = ("sshade/cli", "sshade/edit", "sshade/figures.py", "sshade/threejs")
#: Its packages; methods of all others are those of users.
OWN = frozenset(name.split("/")[0] for name in CODE)
#: What of a checkout can change them; not results or pages of text.
TREE = ("sshade", "baselines", "defaust", "eval", "conf", "pyproject.toml", "constraints.txt")
#: Libraries whose versions are part of every key.
LIBRARIES = ("numpy", "scipy", "numba", "libigl")
#: The same, for methods alone whose modules import them.
OPTIONAL = ("torch",)


def digest(*parts: bytes) -> str:
    """16 hex digits of the SHA-256 of the parts, each preceded by its length."""
    sha = hashlib.sha256()
    for part in parts:
        sha.update(len(part).to_bytes(8, "little"))
        sha.update(part)
    return sha.hexdigest()[:16]


def config_hash(config: Mapping[str, Any]) -> str:
    """Hash of plain, resolved settings; independent of their order."""
    return digest(json.dumps(config, sort_keys=True).encode())


def task_checksum(task: DeformationTask | TransferTask) -> str:
    """Hash of what a method sees: the mesh, and the handles and a guess or a pose, not the task's name."""
    if isinstance(task, TransferTask):
        arrays = [task.mesh.V, task.mesh.F, task.rest.V, task.posed]
    else:
        handles = task.handles
        arrays = [task.mesh.V, task.mesh.F, handles.index, handles.target, handles.dynamic, handles.group]
        if task.guess is not None:
            arrays.append(task.guess)
        if not handles.hard.all():
            arrays += [handles.weight, handles.portion]
        if handles.rotation is not None:
            arrays.append(handles.rotation)
        if task.carry_unconstrained:
            arrays.append(np.ones(1))
    return digest(*(np.ascontiguousarray(array).tobytes() for array in arrays))


class Code:
    """Python files as they are when this is made: before this process imports them, or while it does.

    Parameters
    ----------
    paths : iterable of path
        Files, and folders with all that is below them.
    folder : path
        Places of files are told from here.
    without : iterable of path
        Files and folders left out.

    Attributes
    ----------
    hashes : dict
        16 hex digits by the place of a file.
    version : str
        16 hex digits of them all.
    """

    def __init__(self, paths: Iterable[Path], *, folder: Path, without: Iterable[Path] = ()) -> None:
        self._paths, self._folder, self._without = tuple(paths), folder, tuple(without)
        self._stamps = self._look()  # before the files are read: an edit in between shows
        self.hashes = {place: digest((folder / place).read_bytes()) for place in sorted(self._stamps)}
        self.version = digest(*(text.encode() for pair in self.hashes.items() for text in pair))

    def _look(self) -> dict[str, tuple[int, int]]:
        """When each file was written, and its size."""
        files = [f for f in _python_files(self._paths) if not any(map(f.is_relative_to, self._without))]
        stats = {f.relative_to(self._folder).as_posix(): f.stat() for f in files}
        return {place: (stat.st_mtime_ns, stat.st_size) for place, stat in stats.items()}

    def edited(self) -> str | None:
        """The place of a file that was written, added or removed since; None where there is none."""
        now = self._look()
        return _difference(self._stamps, now) if now != self._stamps else None


def _python_files(paths: Iterable[Path]) -> list[Path]:
    """The files among paths, and those of Python below the folders among them."""
    return [file for path in paths for file in ([path] if path.is_file() else path.rglob("*.py"))]


def _difference(one: Mapping[str, Any], other: Mapping[str, Any]) -> str | None:
    """The first place at which two records of files differ."""
    return min((place for place in {*one, *other} if one.get(place) != other.get(place)), default=None)


#: The code, and what measures, as this process loaded it.
LOADED = Code(
    (PACKAGES / name for name in CODE), folder=PACKAGES, without=(PACKAGES / name for name in SHOWN)
)
MEASURES = Code([PACKAGES / "eval" / "metrics"], folder=PACKAGES)
#: Their versions: columns ``env.version.code`` and ``env.version.metrics``.
SOURCES, METRICS = LOADED.version, MEASURES.version


class CodeChanged(InputError):
    """The code is no longer what the command began with: no run can follow, and none under way be kept."""


class Foreign(NamedTuple):
    """The code of a top-level module or package that is not ours, and the names of those that it imports."""

    code: Code
    imports: tuple[str, ...]


@cache
def foreign_code(top: str) -> Foreign | None:
    """A module or package as it is when first asked for; None if not found."""
    paths = _places(top)
    if not paths:
        return None
    code = Code(paths, folder=Path(os.path.commonpath(paths)).parent)
    # Files beside a user's method belong to it; libraries are told by their versions.
    names = set() if _installed(paths) else _imported(paths) - OWN - sys.stdlib_module_names
    return Foreign(code, tuple(name for name in sorted(names) if not _installed(_places(name))))


def _imported(paths: Iterable[Path]) -> set[str]:
    """Top-level names of the modules that Python files import, in functions too."""
    names: set[str] = set()
    for file in _python_files(paths):
        try:
            nodes = list(ast.walk(ast.parse(file.read_bytes())))
        except SyntaxError:  # then nothing can import it
            continue
        names.update(
            alias.name.split(".")[0] for node in nodes if isinstance(node, ast.Import) for alias in node.names
        )
        names.update(
            node.module.split(".")[0]
            for node in nodes
            if isinstance(node, ast.ImportFrom) and node.module and not node.level
        )
    return names


def _installed(paths: Iterable[Path]) -> bool:
    """Whether files lie where libraries are installed."""
    folders = (*site.getsitepackages(), site.getusersitepackages())
    return any(path.is_relative_to(folder) for path in paths for folder in folders)


def _foreign(modules: Iterable[str]) -> list[Code]:
    """The packages of others that modules belong to, and those that these import."""
    waiting = {module.split(".")[0] for module in modules} - OWN
    found: dict[str, Foreign | None] = {}
    while waiting:
        top = waiting.pop()
        found[top] = foreign_code(top)
        waiting.update({*found[top].imports} - found.keys() if found[top] else ())
    return [foreign.code for _, foreign in sorted(found.items()) if foreign is not None]


def method_sources(modules: Iterable[str]) -> str:
    """Hash of the code that a method runs on: all of ours, the packages of others that it names, and files
    of the user's own that these import.
    """
    return digest(SOURCES.encode(), *(code.version.encode() for code in _foreign(modules)))


def loaded_code(modules: Iterable[str]) -> dict[str, str]:
    """Hashes of all files, by place, that the rows of methods of these modules depend on, as loaded."""
    codes = [LOADED, MEASURES, *_foreign(modules)]
    return {place: text for code in codes for place, text in code.hashes.items()}


def require_unchanged(modules: Iterable[str], *, begun_with: Mapping[str, str] | None = None) -> None:
    """Check that files on the disk, from which a module may be imported yet, are those of the hashes.

    Parameters
    ----------
    modules : iterable of str
        Of the functions of a method.
    begun_with : mapping, optional
        :func:`loaded_code` of the process that this one runs for.

    Raises
    ------
    CodeChanged
        When a file was written, added or removed, or this process loaded others than the one it runs for.
    """
    place = next(filter(None, (code.edited() for code in (LOADED, MEASURES, *_foreign(modules)))), None)
    if place is None and begun_with is not None:
        own = loaded_code(modules)
        place = next((place for place in own if own[place] != begun_with.get(place)), None)
    if place is not None:
        raise CodeChanged(
            f"{place} has changed since the command began, so that its runs would be of two versions of the "
            "code; start the command again: the rows that are there stay"
        )


def library_versions(modules: Sequence[str]) -> dict[str, str]:
    """Versions of the libraries that a method's numbers depend on, by distribution."""
    text = "".join(path.read_text() for module in modules for path in _python_files(_places(module)))
    used = [name for name in OPTIONAL if re.search(rf"^ *(?:import|from) {name}\b", text, re.MULTILINE)]
    return {name: version_of(name) for name in (*LIBRARIES, *used)}


def _places(module: str) -> list[Path]:
    """The Python file of a module, or the folders of a package; none where it is not found."""
    search_here()
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError):  # the latter where it has none, as __main__
        return []
    if spec is None:
        return []
    folders = spec.submodule_search_locations
    if folders:
        return [Path(folder) for folder in folders]
    return [Path(spec.origin)] if spec.origin and spec.origin.endswith(".py") else []


def version_of(distribution: str) -> str:
    """Installed version of a distribution, or "absent"."""
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return "absent"


def process_memory(key: str) -> int | None:
    """A figure of this process's memory in bytes, such as ``VmRSS`` or ``VmHWM``; None where not Linux."""
    entry = _entry("self/status", key)
    return 1024 * int(entry.split()[0]) if entry else None


def _entry(name: str, key: str) -> str:
    """What the first line ``key: ...`` of a file in Linux's /proc says; empty where there is none."""
    path = Path("/proc", name)
    text = path.read_text(errors="replace") if path.is_file() else ""
    found = re.search(rf"^{key}\s*:(.*)", text, re.MULTILINE)
    return found[1].strip() if found else ""


def environment(*, jobs: int) -> dict[str, Any]:
    """Flat facts about the machine and the process, for the columns ``env.*``.

    Parameters
    ----------
    jobs : int
        How many runs the launcher executes at once.
    """
    import numba

    facts = dict(_machine())
    facts["python"] = platform.python_version()
    facts["commit"], facts["modified"] = _commit()
    # numba.get_num_threads() would start a threading layer, for no kernel of ours.
    facts["numba_threads"] = numba.config.NUMBA_NUM_THREADS
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        facts[variable.lower()] = os.environ.get(variable, "")
    facts["jobs"] = jobs
    return facts


@cache
def _machine() -> dict[str, Any]:
    facts = {
        "cpu": _entry("cpuinfo", "model name") or platform.processor() or "unknown CPU",
        "cores": available_cpus(),
        "ram_gib": round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30),
        "os": platform.system(),
        "arch": platform.machine(),
    }
    facts["machine"] = "{cpu}, {cores} cores, {ram_gib} GiB, {os} {arch}".format(**facts)
    identity = Path("/etc/machine-id")
    own = identity.read_bytes() if identity.is_file() else b""
    facts["machine_id"] = digest(facts["machine"].encode(), platform.node().encode(), own)[:8]
    return facts


@cache
def _commit() -> tuple[str, bool | None]:
    """Commit of the checkout that holds this file, and whether what can change numbers differs from it.

    Nothing outside of a checkout. New files that git does not ignore are a difference, too.
    """
    folder = Path(__file__).parent
    try:
        # Installed into some other project's folder, that project's commit would mean nothing.
        _git(folder, "ls-files", "--error-unmatch", Path(__file__).name)
        commit = _git(folder, "rev-parse", "HEAD")
        return commit, bool(_git(PACKAGES, "status", "--porcelain", "--untracked-files=all", "--", *TREE))
    except (OSError, subprocess.CalledProcessError):
        return "", None


def _git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

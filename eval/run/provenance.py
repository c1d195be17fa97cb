"""Where a row comes from: machine, versions, commit, and the hashes that make its key."""

from __future__ import annotations

import ast
import hashlib
import importlib.metadata
import importlib.util
import json
import os
import platform
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sshade.pipeline.transfer import TransferTask
from sshade.task import DeformationTask
from sshade.threads import available_cpus

#: Ours: hashed as sources wherever they are installed.
PROJECT = ("sshade", "baselines", "defaust", "eval")


class Dependencies(NamedTuple):
    """What a function's module imports, directly or not.

    Parameters
    ----------
    sources : tuple of str
        Names of project modules, sorted: ours, and any that belong to no installed distribution.
    versions : dict
        Distribution name -> version, "absent" for an optional import that is not installed.
    """

    sources: tuple[str, ...]
    versions: dict[str, str]


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
    return digest(*(np.ascontiguousarray(array).tobytes() for array in arrays))


@cache
def dependencies(*modules: str) -> Dependencies:
    """Follow the import statements of modules, also those inside functions.

    Parameters
    ----------
    modules : str
        Names, such as "baselines.arap". Nothing is executed beyond what finding
        a submodule needs: its parent package is imported.
    """
    project = {*PROJECT, *(name.split(".")[0] for name in modules)}
    owners = importlib.metadata.packages_distributions()
    seen: dict[str, Path] = {}
    libraries: set[str] = set()
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        top = name.split(".")[0]
        if name in seen or top in sys.stdlib_module_names:
            continue
        if top not in project and top in owners:
            libraries.add(top)
            continue
        path = _source(name)
        if path is None:
            if top not in project:
                libraries.add(top)
            continue
        seen[name] = path
        # Not the parent package: its __init__ re-exports, and would tie every method to all of it.
        waiting.extend(_imports(name, path))
    versions = {}
    for library in sorted(libraries):
        for distribution in owners.get(library, [library]):
            versions[distribution] = version_of(distribution)
    return Dependencies(tuple(sorted(seen)), dict(sorted(versions.items())))


def source_hash(modules: tuple[str, ...]) -> str:
    """Hash of the text of project modules."""
    return digest(*(part for name in modules for part in (name.encode(), _source(name).read_bytes())))


def version_of(distribution: str) -> str:
    """Installed version of a distribution, or "absent"."""
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return "absent"


def process_memory(key: str) -> int | None:
    """A figure of this process's memory in bytes, such as ``VmRSS`` or ``VmHWM``; None where not Linux."""
    status = Path("/proc/self/status")
    if status.is_file():
        for line in status.read_text().splitlines():
            if line.startswith(f"{key}:"):
                return 1024 * int(line.split()[1])
    return None


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
    facts["concurrent"] = jobs > 1
    facts["load"] = round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None
    return facts


@cache
def _machine() -> dict[str, Any]:
    ram = None
    if "SC_PHYS_PAGES" in getattr(os, "sysconf_names", {}):
        ram = round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30)
    facts = {
        "cpu": _cpu_model(),
        "cores": available_cpus(),
        "ram_gib": ram,
        "os": platform.system(),
        "arch": platform.machine(),
    }
    facts["machine"] = "{cpu}, {cores} cores, {ram_gib} GiB, {os} {arch}".format(**facts)
    return facts


def _cpu_model() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        for line in cpuinfo.read_text(errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown CPU"


@cache
def _commit() -> tuple[str, bool | None]:
    """Commit of the checkout that holds this file, and whether files differ from it; empty outside of one."""
    folder = Path(__file__).parent
    try:
        # Installed into some other project's folder, that project's commit would mean nothing.
        _git(folder, "ls-files", "--error-unmatch", Path(__file__).name)
        commit = _git(folder, "rev-parse", "HEAD")
        return commit, bool(_git(folder, "status", "--porcelain", "--untracked-files=no"))
    except (OSError, subprocess.CalledProcessError):
        return "", None


def _git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def _source(module: str) -> Path | None:
    """File of a Python module; None for a namespace, a compiled or a missing one, or a name in a module."""
    try:
        spec = importlib.util.find_spec(module)
    except ImportError:
        return None
    if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
        return None
    return Path(spec.origin)


def _imports(module: str, path: Path) -> list[str]:
    """Names that a module's import statements may load; ``from a import b`` may mean the module ``a.b``."""
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    names = []
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parents = package.split(".")
                base = ".".join([*parents[: len(parents) - node.level + 1], *([base] if base else [])])
            names += [base, *(f"{base}.{alias.name}" for alias in node.names)]
    return names

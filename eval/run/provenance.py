"""Where a row comes from: machine, versions, commit, and the hashes that make its key."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.util
import json
import os
import platform
import re
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from sshade.cli.configuration import PACKAGES
from sshade.pipeline.transfer import TransferTask
from sshade.task import DeformationTask
from sshade.threads import available_cpus

#: Folders of the code that can change the numbers of a row.
CODE = ("sshade", "baselines", "defaust", "eval/configure", "eval/run")
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
    return digest(*(np.ascontiguousarray(array).tobytes() for array in arrays))


def hash_of(files: Iterable[Path], *, folder: Path) -> str:
    """Hash of files, and of their places in a folder."""
    parts = ((path.relative_to(folder).as_posix().encode(), path.read_bytes()) for path in sorted(files))
    return digest(*(part for pair in parts for part in pair))


#: Hashes of the code, and of what measures, as this process loaded them: an edit in a sweep changes neither.
SOURCES = hash_of((path for name in CODE for path in (PACKAGES / name).rglob("*.py")), folder=PACKAGES)
METRICS = hash_of((PACKAGES / "eval" / "metrics").rglob("*.py"), folder=PACKAGES)


@cache
def foreign_sources(top: str) -> str:
    """Hash of a top-level module or package that is not ours, as it is when it is first asked for."""
    files = _files(top)
    return hash_of(files, folder=Path(os.path.commonpath(files)).parent) if files else ""


def method_sources(modules: Sequence[str]) -> str:
    """Hash of the code that a method runs on: all of ours, and the packages of others that it names."""
    tops = {module.split(".")[0] for module in modules} - {name.split("/")[0] for name in CODE}
    return digest(SOURCES.encode(), *(foreign_sources(top).encode() for top in sorted(tops)))


def library_versions(modules: Sequence[str]) -> dict[str, str]:
    """Versions of the libraries that a method's numbers depend on, by distribution."""
    text = "".join(path.read_text() for module in modules for path in _files(module))
    used = [name for name in OPTIONAL if re.search(rf"^ *(?:import|from) {name}\b", text, re.MULTILINE)]
    return {name: version_of(name) for name in (*LIBRARIES, *used)}


def _files(module: str) -> list[Path]:
    """The Python file of a module, or those of a package; none where it is not found."""
    try:
        spec = importlib.util.find_spec(module)
    except ImportError:
        return []
    if spec is None:
        return []
    folders = spec.submodule_search_locations
    if folders:
        return [path for folder in folders for path in Path(folder).rglob("*.py")]
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
    facts["concurrent"] = jobs > 1
    facts["load"] = round(os.getloadavg()[0], 2)
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
    return facts


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

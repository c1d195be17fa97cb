"""Where a row comes from: machine, library versions, commit, and hashes of its settings and its task."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import math
import os
import platform
import re
import subprocess
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from eval import PACKAGES
from eval.run.targets import flat, settings
from sshade.core.errors import InputError
from sshade.core.threads import available_cpus
from sshade.problem.task import DeformationTask, TransferTask

#: Parts of a checkout that can change the numbers of a row, in contrast to results and pages.
TREE = ("sshade", "baselines", "defaust", "eval", "conf", "pyproject.toml", "constraints.txt")
#: Libraries whose versions a row has.
LIBRARIES = ("numpy", "scipy", "numba", "libigl", "pymeshlab", "pandas", "hydra-core", "torch")


def digest(*parts: bytes) -> str:
    """Return 16 hex digits of the SHA-256 of the parts, each preceded by its length."""
    sha = hashlib.sha256()
    for part in parts:
        sha.update(len(part).to_bytes(8, "little"))
        sha.update(part)
    return sha.hexdigest()[:16]


def config_hash(config: Mapping[str, Any]) -> str:
    """Return a hash of plain, resolved settings; their order does not matter."""
    return digest(json.dumps(config, sort_keys=True).encode())


def task_checksum(task: DeformationTask | TransferTask) -> str:
    """Return a hash of all arrays of a task that a method reads; the name of the task does not matter."""
    if isinstance(task, TransferTask):
        arrays = [task.mesh.V, task.mesh.F, task.rest.V, task.posed]
    else:
        handles = task.handles
        arrays = [task.mesh.V, task.mesh.F, handles.index, handles.target, handles.dynamic, handles.group]
        if task.guess is not None:
            arrays.append(task.guess)
        if not handles.hard.all():
            assert handles.portion is not None, "a task gives soft handles their portions"
            arrays += [handles.weight, handles.portion]
        if handles.rotation is not None:
            arrays.append(handles.rotation)
        if task.refuse_unconstrained:
            arrays.append(np.ones(1))
    return digest(*(np.ascontiguousarray(array).tobytes() for array in arrays))


def task_facts(task: DeformationTask | TransferTask) -> dict[str, Any]:
    """Return the columns ``task.*`` that identify a task and its size."""
    size = {"task.vertices": task.mesh.n, "task.faces": task.mesh.m}
    return {"task.name": task.name, "task.checksum": task_checksum(task), **size}


def method_facts(name: str, config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the columns ``method.*``. A method without a version has version 1.

    Raises
    ------
    InputError
        When a setting is NaN, which no row can hold, or has the name of another column, or the version is no
        number from 1 on.
    """
    plain, version = settings(config), config.get("version", 1)
    if type(version) is not int or version < 1:
        raise InputError(f"method.version={version} does not fit; it takes a number from 1 on")
    facts = {"method.name": name, "method.hash": config_hash(plain), "method.version": version}
    if taken := [name for name in ("name", "hash") if name in plain]:
        raise InputError(
            f"a method cannot have the parameter {taken[0]!r}, which is a column of rows; rename it"
        )
    facts |= flat(plain, "method")
    for setting, value in facts.items():
        if isinstance(value, float) and math.isnan(value):
            raise InputError(f"{setting} is NaN; give it a number")
    return facts


def version_of(distribution: str) -> str:
    """Return the installed version of a distribution, or "absent"."""
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return "absent"


def process_memory(key: str) -> int | None:
    """Return a figure of this process's memory in bytes, such as ``VmRSS``; None except on Linux."""
    entry = _entry("self/status", key)
    return 1024 * int(entry.split()[0]) if entry else None


def reset_peak_memory() -> None:
    """Let the peak ``VmHWM`` start again at the memory in use; only on Linux."""
    Path("/proc/self/clear_refs").write_text("5")


def _entry(name: str, key: str) -> str:
    """Return the value in the first line ``key: ...`` of a file in Linux's /proc; empty if it is missing."""
    path = Path("/proc", name)
    text = path.read_text(errors="replace") if path.is_file() else ""
    found = re.search(rf"^{key}\s*:(.*)", text, re.MULTILINE)
    return found[1].strip() if found else ""


def environment(*, jobs: int) -> dict[str, Any]:
    """Return facts about the machine and the process, for the columns ``env.*``.

    Parameters
    ----------
    jobs : int
        Number of runs that the launcher executes at once.
    """
    import numba

    facts = dict(_machine())
    facts["python"] = platform.python_version()
    facts["commit"], facts["modified"] = _commit()
    # numba.get_num_threads() would start a threading layer, which no kernel of the project uses.
    facts["numba_threads"] = numba.config.NUMBA_NUM_THREADS
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        facts[variable.lower()] = os.environ.get(variable, "")
    facts["jobs"] = jobs
    facts |= {f"version.{name}": version_of(name) for name in LIBRARIES}
    return facts | {"version.blas": _blas()}


@cache
def _blas() -> str:
    """Return the name and version of the BLAS that NumPy was built with."""
    blas = np.__config__.CONFIG["Build Dependencies"]["blas"]
    return f"{blas['name']} {blas['version']}"


@cache
def _machine() -> dict[str, Any]:
    facts = {
        "cpu": _entry("cpuinfo", "model name") or platform.processor() or "unknown CPU",
        "cores": available_cpus(),
        "ram_gib": round(psutil.virtual_memory().total / 2**30),
        "os": platform.system(),
        "arch": platform.machine(),
    }
    facts["machine"] = "{cpu}, {cores} cores, {ram_gib} GiB, {os} {arch}".format_map(facts)
    identity = Path("/etc/machine-id")
    own = identity.read_bytes() if identity.is_file() else b""
    facts["machine_id"] = digest(facts["machine"].encode(), platform.node().encode(), own)[:8]
    return facts


@cache
def _commit() -> tuple[str, bool | None]:
    """Return the commit of the checkout that holds this file, and whether :data:`TREE` differs from it.

    New files that git does not ignore are a difference. Outside of a checkout: "" and None.
    """
    folder = Path(__file__).parent
    try:
        # If this package is installed in the checkout of another project, its commit means nothing.
        _git(folder, "ls-files", "--error-unmatch", Path(__file__).name)
        commit = _git(folder, "rev-parse", "HEAD")
        return commit, bool(_git(PACKAGES, "status", "--porcelain", "--untracked-files=all", "--", *TREE))
    except (OSError, subprocess.CalledProcessError):
        return "", None


def _git(folder: Path, *arguments: str) -> str:
    # The clone may belong to another user. Its code is running, so that it is safe for git as well.
    command = ["git", "-c", f"safe.directory={PACKAGES.resolve()}", "-C", str(folder), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

"""A program in any language as a method.

The program gets a mesh file, a file of handles and the name of the file to write. ``docs/add_method.md``
shows the files. The seed and the time limit are in the environment variables ``EVAL_SEED`` and
``EVAL_TIME_LIMIT``.

Proof: the program itself; files keep every bit of its result (tests/baselines/test_external.py).
"""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from baselines.hard_handles import require_hard
from baselines.program import Finished, ProgramFailed, last_line, run_program
from baselines.stopwatch import Stopwatch
from sshade.core.errors import InputError
from sshade.core.progress import Progress, silent
from sshade.files.meshes import read_file, write_mesh
from sshade.files.task_files import write_handles
from sshade.problem.handles import Handles
from sshade.problem.task import DeformationResult, DeformationTask

#: Words of a command that stand for files, which must be among the arguments of the program.
FILES = ("{mesh}", "{handles}", "{output}")
#: Variable with the time limit of a run in seconds; missing in a run without a limit.
TIME_LIMIT = "EVAL_TIME_LIMIT"


def external(
    task: DeformationTask,
    *,
    command: list[str],
    mesh_format: Literal["ply", "obj", "off"] = "ply",
    handles_format: Literal["json", "txt"] = "json",
    output_format: Literal["ply", "obj", "off", "npy", "txt"] = "ply",
    seed: int = 0,
    progress: Progress = silent,
) -> DeformationResult:
    """Deform with a program.

    Parameters
    ----------
    task : DeformationTask
    command : list of str
        The program and its arguments; no shell reads them. ``{mesh}``, ``{handles}`` and ``{output}`` stand
        for the files, ``{seed}`` and ``{time_limit}`` for numbers. A command without placeholders gets the
        three files as its last arguments. Relative paths begin at the current folder.
    mesh_format : {"ply", "obj", "off"}
        Format of the mesh. PLY is binary with positions as float64.
    handles_format : {"json", "txt"}
        Format of the handles: the project's JSON, or lines ``vertex x y z``.
    output_format : {"ply", "obj", "off", "npy", "txt"}
        Format of the result: a mesh with the vertices in the same order, or the positions alone.
    seed : int
    progress : Progress
        Unused.

    Returns
    -------
    DeformationResult
        ``seconds`` has the stages write, program and read. ``reported`` is the time that the program itself
        reports. ``extra["peak_mib"]`` is the memory of the program and its child processes.

    Raises
    ------
    InputError
        When the command is no list of words or does not start; when the format of the handles is unknown or
        cannot hold them.
    ProgramFailed
        On an exit code other than 0, a missing or unreadable result, another number of vertices, and
        positions that are not finite.
    TimeoutError
        When the run has a time limit, and the program does not meet it.
    """
    limit = os.environ.get(TIME_LIMIT)
    formats = mesh_format, handles_format, output_format
    finished, V, report, seconds = _run(
        task, words_of(command), formats, seed=seed, limit=None if limit is None else float(limit)
    )
    if "seconds" in report:
        seconds["reported"] = report.pop("seconds")
    return DeformationResult(
        V,
        iterations=report.pop("iterations", 0),
        converged=report.pop("converged", None),
        seconds=seconds,
        extra={**report, "peak_mib": finished.peak_mib},
    )


def words_of(command: Any) -> list[str]:
    """Return the words of a command; the placeholders of the files are appended where all are missing.

    Raises
    ------
    InputError
        When `command` is not a list of texts and numbers, or has some of the files only.
    """
    if not isinstance(command, (list, tuple)) or not command or not all(map(_is_word, command)):
        raise InputError(
            f"command={command!r} is not a list of words; write method.command=[python3,mymethod.py], with "
            'placeholders in quotes: "{mesh}"'
        )
    words = [str(word) for word in command]
    missing = [name for name in FILES if not any(name in word for word in words)]
    if not missing:
        return words
    if len(missing) < len(FILES):
        raise InputError(f"command={words} lacks {missing[0]}; name {', '.join(FILES)}, or none of them")
    return [*words, *FILES]


def _is_word(word: Any) -> bool:
    return isinstance(word, (str, int, float)) and not isinstance(word, bool) and "\0" not in str(word)


def _run(
    task: DeformationTask, words: list[str], formats: tuple[str, str, str], *, seed: int, limit: float | None
) -> tuple[Finished, np.ndarray, dict[str, Any], dict[str, float]]:
    """Write the files of a task, run the program, and read its result and its report."""
    watch = Stopwatch()
    with TemporaryDirectory(prefix="sshade_external_", ignore_cleanup_errors=True) as folder:
        mesh, handles, output = (
            Path(folder, f"{name}.{ending}")
            for name, ending in zip(("mesh", "handles", "output"), formats, strict=True)
        )
        write_mesh(mesh, task.mesh.V, task.mesh.F)
        _write_handles(handles, task.handles)
        values = {"mesh": mesh, "handles": handles, "output": output, "seed": seed}
        values["time_limit"] = "inf" if limit is None else f"{limit:g}"
        watch.end("write")
        finished = run_program(
            [_filled(word, values) for word in words],
            variables={"EVAL_SEED": str(seed)},
            errors=Path(folder, "stderr.txt"),
            limit=limit,
        )
        watch.end("program")
        said = last_line(Path(folder, "stderr.txt"))
        V, report = _read(output, task.mesh.n, said), _report(Path(f"{output}.json"), said)
        watch.end("read")
    return finished, V, report, watch.seconds | {"program": finished.seconds}


def _filled(word: str, values: dict[str, Any]) -> str:
    """Return a word with its placeholders replaced. All other braces stay, as in a program for awk."""
    for name, value in values.items():
        word = word.replace(f"{{{name}}}", str(value))
    return word


def _write_handles(path: Path, handles: Handles) -> None:
    if path.suffix == ".json":
        write_handles(path, handles)
        return
    if path.suffix != ".txt":
        raise InputError(f"handles_format={path.suffix[1:]} is unknown; use json or txt")
    require_hard(handles, "handles_format=txt")
    rows = zip(handles.index.tolist(), handles.target.tolist(), strict=True)
    path.write_text("".join(f"{i} {x!r} {y!r} {z!r}\n" for i, (x, y, z) in rows), encoding="ascii")


def _read(path: Path, n: int, said: str) -> np.ndarray:
    """Return the positions that a program wrote, (n, 3) float64."""
    if not path.is_file():
        raise ProgramFailed(f"the program wrote no {path.name}{said}")
    try:
        if path.suffix == ".npy":
            V = np.load(path, allow_pickle=False)
        elif path.suffix == ".txt":
            V = np.loadtxt(path, ndmin=2)
        else:
            V = read_file(path).V
        V = np.array(V, dtype=np.float64)
    except (InputError, ValueError, TypeError, OSError, EOFError) as error:
        text = " ".join(str(error).replace(f"{path}: ", "").split())
        raise ProgramFailed(f"{path.name} of the program is not readable ({text}){said}") from error
    if V.shape != (n, 3):
        shape = f"{len(V)} vertices" if V.shape[1:] == (3,) else f"an array of shape {V.shape}"
        raise ProgramFailed(f"the program wrote {shape}, and the mesh has {n} vertices{said}")
    bad = int((~np.isfinite(V).all(axis=1)).sum())
    if bad:
        raise ProgramFailed(f"{bad} of the {n} vertices that the program wrote are not finite{said}")
    return V


def _report(path: Path, said: str) -> dict[str, Any]:
    """Return what a program reports of itself, {} without a report."""
    if not path.is_file():
        return {}
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, OSError, RecursionError) as error:
        raise ProgramFailed(f"{path.name} of the program is not JSON ({error}){said}") from error
    kinds = {"seconds": (int, float), "iterations": (int, float), "converged": (bool, type(None))}
    if not isinstance(report, dict):
        raise ProgramFailed(f"{path.name} of the program is no mapping of names to values{said}")
    for name, value in report.items():
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        right = isinstance(value, kinds.get(name, (bool, int, float, str, type(None))))
        if not right or (name in ("seconds", "iterations") and not (number and 0 <= value < math.inf)):
            raise ProgramFailed(f"{path.name} of the program has {name}={value!r}{said}")
    return report

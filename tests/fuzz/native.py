"""Files that compiled code reads, mutated: in a child process, under a time limit."""

from __future__ import annotations

import io
import multiprocessing
import signal
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from pathlib import Path

import numpy as np

from defaust.sources.files import Shape, find_shapes
from sshade import InputError
from tests.fuzz.mutate import mutated
from tests.shapes import icosphere

#: Seconds for one file.
SECONDS = 20


@cache
def _seeds() -> dict[str, list[bytes]]:
    """Sound files by suffix: MATLAB's, numpy's archives, tables of numbers."""
    from scipy.io import savemat

    ball = icosphere(0)
    surface = {"X": ball.V[:, :1], "Y": ball.V[:, 1:2], "Z": ball.V[:, 2:], "TRIV": (ball.F + 1).astype("u2")}
    writers = (
        (".mat", lambda file: savemat(file, {"surface": surface})),
        (".mat", lambda file: savemat(file, {"surface": surface}, do_compression=True)),
        (".npz", lambda file: np.savez(file, V_0=ball.V, V_1=2 * ball.V, F=ball.F)),
        (".npz", lambda file: np.savez_compressed(file, V_0=ball.V, V_1=2 * ball.V, F=ball.F)),
        (".vert", lambda file: np.savetxt(file, ball.V, fmt="%.9g")),
        (".tri", lambda file: np.savetxt(file, ball.F + 1, fmt="%d")),
    )
    found: dict[str, list[bytes]] = {}
    for suffix, write in writers:
        buffer = io.BytesIO()
        write(buffer)
        found.setdefault(suffix, []).append(buffer.getvalue())
    return found


def _read(folder: Path, suffix: str) -> None:
    """Read what lies in the folder as a sequence of meshes; InputError where that cannot be."""
    if suffix == ".npz":
        for shapes in find_shapes(folder / "a.npz", layout="auto")[0].values():
            for shape in shapes:
                shape.mesh()
    else:
        Shape("a", folder / f"a{'.vert' if suffix == '.tri' else suffix}").mesh()


def _problem(suffix: str, number: int, folder: Path) -> str:
    """How reading a mutated file ends, where it is neither read nor refused."""
    for other, content in _seeds().items():
        data = mutated(content, (), number=number) if other == suffix else content[0]
        (folder / f"a{other}").write_bytes(data)
    signal.alarm(SECONDS)  # ends the process, compiled code or not
    try:
        _read(folder, suffix)
    except InputError:
        pass
    except BaseException as error:
        return f"{type(error).__name__}: {error}"
    finally:
        signal.alarm(0)
    return ""


def problems_of(files: int, folder: Path) -> list[str]:
    """Which of so many mutated files crash, hang, or raise something else than InputError."""
    context = multiprocessing.get_context("spawn")
    suffixes = list(_seeds())
    problems, pool = [], ProcessPoolExecutor(1, context)
    for number in range(files):
        suffix = suffixes[number % len(suffixes)]
        try:
            problem = pool.submit(_problem, suffix, number, folder).result()
        except BrokenProcessPool:
            problem, pool = "the process ended or hung", ProcessPoolExecutor(1, context)
        if problem:
            problems.append(f"mutation {number} of {suffix}: {problem}")
    pool.shutdown()
    return problems

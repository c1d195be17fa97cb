"""Files that compiled code reads, mutated: in a child process, under a time limit."""

from __future__ import annotations

import io
import multiprocessing
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from defaust.sources.files import Shape, find_shapes
from sshade import InputError
from tests.fuzz.mutate import mutated
from tests.shapes import icosphere

#: Seconds for one file.
SECONDS = 20


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
        for shapes in find_shapes(folder / "a.npz", layout="auto").values():
            for shape in shapes:
                shape.mesh()
    else:
        Shape("a", folder / f"a{'.vert' if suffix == '.tri' else suffix}").mesh()


def _work(connection: Connection, folder: Path) -> None:
    """Read mutated files as they are asked for, and say how each ended."""
    sound = _seeds()
    for suffix, content in sound.items():
        (folder / f"a{suffix}").write_bytes(content[0])
    while True:
        suffix, number = connection.recv()
        (folder / f"a{suffix}").write_bytes(mutated(sound[suffix], (), number=number))
        problem = ""
        try:
            _read(folder, suffix)
        except InputError:
            pass
        except BaseException as error:
            problem = f"{type(error).__name__}: {error}"
        connection.send(problem)
        (folder / f"a{suffix}").write_bytes(sound[suffix][0])


def problems_of(files: int, folder: Path) -> list[str]:
    """Which of so many mutated files crash, hang, or raise something else than InputError."""
    context = multiprocessing.get_context("spawn")
    suffixes = list(_seeds())
    problems, process = [], None
    try:
        for number in range(files):
            if process is None:
                connection, theirs = context.Pipe()
                # No daemon: it has a child of its own for some formats.
                process = context.Process(target=_work, args=(theirs, folder))
                process.start()
                theirs.close()
            suffix = suffixes[number % len(suffixes)]
            try:
                connection.send((suffix, number))
                answered = connection.poll(SECONDS)
                problem = connection.recv() if answered else f"no answer within {SECONDS} s"
            except (EOFError, BrokenPipeError, ConnectionResetError):
                problem = "the process ended"
            if problem:
                problems.append(f"mutation {number} of {suffix}: {problem}")
                process.kill()
                process = None
    finally:
        if process is not None:
            process.kill()
    return problems

"""Files that compiled code reads, mutated: in a child process, under a time limit."""

from __future__ import annotations

import io
import multiprocessing
import tempfile
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from defaust.sources.shapes import Shape, find_shapes
from sshade import InputError
from tests.fuzz.mutate import mutated
from tests.shapes import icosphere

#: Seconds for one file.
SECONDS = 20


def seeds() -> dict[str, list[bytes]]:
    """Sound files by suffix: MATLAB's, numpy's archives, tables of numbers."""
    from scipy.io import savemat

    ball = icosphere(0)
    surface = {"X": ball.V[:, :1], "Y": ball.V[:, 1:2], "Z": ball.V[:, 2:], "TRIV": (ball.F + 1).astype("u2")}
    found: dict[str, list[bytes]] = {".mat": [], ".npz": [], ".vert": [], ".tri": []}
    for compressed in (False, True):
        buffer = io.BytesIO()
        savemat(buffer, {"surface": surface}, do_compression=compressed)
        found[".mat"].append(buffer.getvalue())
    for save in (np.savez, np.savez_compressed):
        buffer = io.BytesIO()
        save(buffer, V_0=ball.V, V_1=2 * ball.V, F=ball.F)
        found[".npz"].append(buffer.getvalue())
    for suffix, array, form in ((".vert", ball.V, "%.9g"), (".tri", ball.F + 1, "%d")):
        buffer = io.BytesIO()
        np.savetxt(buffer, array, fmt=form)
        found[suffix].append(buffer.getvalue())
    return found


def read(folder: Path, suffix: str) -> None:
    """Read what lies in the folder as a sequence of meshes; InputError where that cannot be."""
    if suffix == ".npz":
        for shapes in find_shapes(folder / "a.npz", layout="auto").values():
            for shape in shapes:
                shape.mesh()
    else:
        Shape("a", folder / f"a{'.vert' if suffix == '.tri' else suffix}").mesh()


def _work(connection: Connection, folder: Path) -> None:
    """Read mutated files as they are asked for, and say how each ended."""
    sound = seeds()
    for suffix, content in sound.items():
        (folder / f"a{suffix}").write_bytes(content[0])
    while True:
        suffix, number = connection.recv()
        data = mutated(sound[suffix], (), number=number)
        (folder / f"a{suffix}").write_bytes(data)
        try:
            read(folder, suffix)
            connection.send("")
        except InputError:
            connection.send("")
        except BaseException as error:
            connection.send(f"{type(error).__name__}: {error}")
        (folder / f"a{suffix}").write_bytes(sound[suffix][0])


class _Child:
    """A process that reads, begun again after each that ended or hung."""

    def __init__(self, folder: Path) -> None:
        self._context = multiprocessing.get_context("spawn")
        self._folder = folder
        self._begin()

    def _begin(self) -> None:
        self._connection, theirs = self._context.Pipe()
        # No daemon: it has a child of its own for some formats.
        self._process = self._context.Process(target=_work, args=(theirs, self._folder))
        self._process.start()
        theirs.close()

    def read(self, suffix: str, number: int) -> str:
        """What went wrong with a mutated file; empty where it was read or refused."""
        try:
            self._connection.send((suffix, number))
            answered = self._connection.poll(SECONDS)
            problem = self._connection.recv() if answered else f"no answer within {SECONDS} s"
        except (EOFError, BrokenPipeError, ConnectionResetError):
            problem = "the process ended"
        if problem:
            self._end()
            self._begin()
        return problem

    def _end(self) -> None:
        self._process.kill()
        self._process.join()

    def __enter__(self) -> _Child:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()


def fuzz_native(executions: int, *, seed: int, crashes: Path, begin: int = 0) -> int:
    """How many of so many mutated files crashed, hung, or raised something else than InputError.

    They are those from number `begin` on of the seed.
    """
    sound = seeds()
    suffixes = list(sound)
    failures = 0
    with tempfile.TemporaryDirectory() as folder, _Child(Path(folder)) as child:
        for number in range(begin, begin + executions):
            suffix = suffixes[number % len(suffixes)]
            place = seed * 10**9 + number
            problem = child.read(suffix, place)
            if problem:
                failures += 1
                (crashes / f"native-{place}{suffix}").write_bytes(mutated(sound[suffix], (), number=place))
                print(f"{suffix} {place}: {problem}")  # noqa: T201
    return failures

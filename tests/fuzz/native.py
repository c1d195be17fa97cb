"""Files that compiled code reads, mutated: in a child process, under a time limit."""

from __future__ import annotations

import io
import multiprocessing
import tempfile
from pathlib import Path

import numpy as np

from defaust.shapes import Shape, find_shapes
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


def _work(connection) -> None:
    """Read mutated files as they are asked for, and say how each ended."""
    sound = seeds()
    folder = Path(tempfile.mkdtemp())
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


def fuzz_native(executions: int, *, seed: int, crashes: Path) -> int:
    """How many of so many mutated files crashed, hung, or raised something else than InputError."""
    context = multiprocessing.get_context("spawn")
    sound = seeds()
    suffixes = list(sound)
    child, failures = None, 0
    for number in range(executions):
        if child is None:
            ours, theirs = context.Pipe()
            child = context.Process(target=_work, args=(theirs,), daemon=True)
            child.start()
            theirs.close()
        suffix = suffixes[number % len(suffixes)]
        place = seed * 10**9 + number
        try:
            ours.send((suffix, place))
            problem = ours.recv() if ours.poll(SECONDS) else f"no answer within {SECONDS} s"
        except (EOFError, BrokenPipeError):
            problem = "the process ended"
        if problem:
            failures += 1
            (crashes / f"native-{place}{suffix}").write_bytes(mutated(sound[suffix], (), number=place))
            print(f"{suffix} {place}: {problem}")  # noqa: T201
            child.kill()
            child = None
    if child is not None:
        child.kill()
        child.join()
    return failures

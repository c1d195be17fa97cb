"""Compute cases of :mod:`tools.compare` with the package of one source tree.

The program reads one case a line from its standard input, and answers each by one line of JSON. It uses
public names of ``sshade`` only, so that it runs in trees of different ages.
"""

from __future__ import annotations

import json
import logging
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np

import sshade

Arrays = dict[str, np.ndarray]
Call = Callable[[], np.ndarray]
#: Options with another spelling in another version. It is tried if the first spelling is refused.
SPELLINGS: dict[tuple[str, Any], dict[str, Any]] = {
    ("method", "paper_plain"): {"method": "paper", "accelerate": False},
    ("method", "fine_free"): {"method": "fine", "volume": 0.0, "area": 0.0},
    ("method", "interpolate"): {"method": "fast", "warp": "always"},
    ("warp", "never"): {},
    ("carry_unconstrained", True): {},
}


def main(tree: str, inputs: str, outputs: str) -> None:
    """Answer all cases. Results are written in units of the diagonal of the mesh at rest."""
    if not Path(sshade.__file__).is_relative_to(tree):
        raise SystemExit(f"{sshade.__file__} was imported instead of the package in {tree}")
    logging.disable()
    calls: dict[str, Call] = {}
    for line in sys.stdin:
        case = json.loads(line)
        seconds = np.nan
        try:
            if case["name"] in calls:
                seconds = fastest(calls[case["name"]])
            else:
                arrays = dict(np.load(f"{inputs}/{case['mesh']}.npz"))
                calls[case["name"]], result = first_run(KINDS[case["kind"]], arrays, case["options"])
                diagonal = np.linalg.norm(np.ptp(arrays["V"], axis=0))
                np.save(f"{outputs}/{case['name']}.npy", result / diagonal)
        except Exception as error:
            print(f"{case['name']} failed in {tree}: {type(error).__name__}: {error}", file=sys.stderr)
        print(json.dumps({"seconds": seconds, "kib": peak_kib()}), flush=True)


def first_run(
    prepare: Callable[..., Call], arrays: Arrays, options: dict[str, Any]
) -> tuple[Call, np.ndarray]:
    """Prepare a case, and call it with the first spelling of its options that the tree accepts."""
    second: dict[str, Any] = {}
    for option in options.items():
        second |= SPELLINGS.get(option, dict([option]))
    try:
        call = prepare(arrays, **options)
        return call, call()
    except (sshade.InputError, TypeError):
        if second == options:
            raise
    call = prepare(arrays, **second)
    return call, call()


def fastest(call: Call, *, enough: float = 0.3) -> float:
    """Return the seconds of the fastest of several calls, which take `enough` seconds together."""
    seconds: list[float] = []
    while sum(seconds) < enough:
        begin = perf_counter()
        call()
        seconds.append(perf_counter() - begin)
    return min(seconds)


def peak_kib() -> int:
    """Return the peak memory of this process, or of its largest child process if that is larger."""
    # ru_maxrss of a process includes the process that started it, and VmHWM does not.
    own = int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0])
    return max(own, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)


def deform(arrays: Arrays, **options: Any) -> Call:
    """Deform a task. Deform arrays if the handles have no groups."""
    V, F, handles = arrays["V"], arrays["F"], {k: v for k, v in arrays.items() if k not in ("V", "F")}
    if "group" not in handles:
        return lambda: sshade.deform(V, F, handles["index"], handles["target"], **options)

    def call() -> np.ndarray:
        task = sshade.DeformationTask("case", sshade.Mesh(V, F), sshade.Handles(**handles))
        return sshade.deform(task, **options).vertices

    return call


def deformer(arrays: Arrays, **options: Any) -> sshade.Deformer:
    """Bind a mesh to its proxy."""
    mesh = sshade.Mesh(arrays["V"], arrays["F"])
    return sshade.Deformer(mesh, arrays["index"], group=arrays["group"], **options)


def bind(arrays: Arrays, **options: Any) -> Call:
    """Bind a mesh, and deform it once."""
    return lambda: deformer(arrays, **options)(arrays["target"]).vertices


def drag(arrays: Arrays, **options: Any) -> Call:
    """Drag the handles of a bound mesh in ten steps, settle, and deform the mesh again from the beginning."""
    bound, rest, target = deformer(arrays, **options), arrays["V"][arrays["index"]], arrays["target"]

    def shapes() -> Iterator[np.ndarray]:
        bound.reset()
        for step in np.linspace(0.1, 1, 10):
            yield bound(rest + step * (target - rest), tolerance=1e-4).vertices
        yield bound.settle().vertices
        bound.reset()
        yield bound(target).vertices

    return lambda: np.array([shape.copy() for shape in shapes()])


def transfer(arrays: Arrays, **options: Any) -> Call:
    """Transfer a pose to an edited mesh."""
    mesh = sshade.Mesh(arrays["V"], arrays["F"])
    return lambda: sshade.transfer_pose(mesh, arrays["posed"], arrays["edited"], **options).vertices


def command(arrays: Arrays, *, poses: int = 1, **options: Any) -> Call:
    """Run ``sshade deform`` with one handle file, or with several files on the way to the targets."""

    def call() -> np.ndarray:
        with TemporaryDirectory() as folder:
            sshade.write(f"{folder}/mesh.ply", arrays["V"], arrays["F"])
            names = [f"pose_{number + 1}.json" for number in range(poses)]
            for number, name in enumerate(names):
                handles = handle_file(arrays, (number + 1) / poses)
                Path(folder, name).write_text(json.dumps(handles))
            output = "out_%02d.ply" if poses > 1 else "out.ply"
            run(folder, "deform", "mesh.ply", *names, "-o", output, **options)
            return np.array([sshade.read(path)[0] for path in sorted(Path(folder).glob("out*.ply"))])

    return call


def handle_file(arrays: Arrays, way: float) -> dict[str, Any]:
    """Return the content of a handle file, with handles at a fraction of the way to their targets."""
    rest, groups = arrays["V"][arrays["index"]], []
    target = rest + way * (arrays["target"] - rest)
    for group in np.unique(arrays["group"]):
        own = arrays["group"] == group
        groups.append({"vertices": arrays["index"][own].tolist(), "target": target[own].tolist()})
    return {"handles": groups}


def remesh(arrays: Arrays, **options: Any) -> Call:
    """Run ``sshade remesh``, bend the proxy, and run ``sshade carry``."""

    def call() -> np.ndarray:
        with TemporaryDirectory() as folder:
            sshade.write(f"{folder}/mesh.ply", arrays["V"], arrays["F"])
            run(folder, "remesh", "mesh.ply", "-o", "proxy.ply", "--map", "map.npz", **options)
            V, F = sshade.read(f"{folder}/proxy.ply")
            sshade.write(f"{folder}/edited.ply", V + 0.2 * np.sin(V[:, [1, 2, 0]]), F)
            run(folder, "carry", "mesh.ply", "map.npz", "edited.ply", "-o", "out.ply")
            return sshade.read(f"{folder}/out.ply")[0]

    return call


def run(folder: str, *arguments: str, **options: Any) -> None:
    """Run a command of ``sshade`` in a folder."""
    switches = [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]
    line = [sys.executable, "-m", "sshade", *arguments, *switches]
    done = subprocess.run(line, cwd=folder, capture_output=True, text=True)
    if done.returncode:
        raise sshade.InputError(done.stderr.strip())


KINDS: dict[str, Callable[..., Call]] = {
    function.__name__: function for function in (deform, bind, drag, transfer, command, remesh)
}

if __name__ == "__main__":
    main(*sys.argv[1:])

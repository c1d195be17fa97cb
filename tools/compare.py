"""Compare the results of two source trees: ``python -m tools.compare OTHER``.

OTHER is the folder of another clone, with its own environment in ``OTHER/.venv``. Both trees deform the same
meshes. The command prints a table of all cases: the largest distance between the two results, as a fraction
of the diagonal of the mesh, and the limit of this distance. It exits with 1 if a result differs.

    python -m tools.compare ../before                            all cases, in three minutes
    python -m tools.compare ../before --times                    with times and memory, in half an hour
    python -m tools.compare ../before --only bodies "drag fast"  cases with one of these texts in their names

With ``--times``, the trees run in turns. The table then has the median seconds of this tree, its time divided
by the time of OTHER, and its peak memory divided by the memory of OTHER. Times need a quiet machine, and
compiled kernels in both trees, which ``make`` provides.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from defaust.tasks import load_task
from sshade import Handles, Mesh
from tests import shapes
from tests.sshade.mesh.test_cutting import moebius

ROOT = Path(__file__).resolve().parents[1]
#: Largest distance between equal results, as a fraction of the diagonal. The polish of ``fine`` amplifies
#: rounding, because it may end before it converges.
LIMIT, LIMIT_OF_FINE = 1e-9, 1e-6
#: Number of measured times of each tree.
ROUNDS = 7
#: Arguments of ``defaust build`` for each dataset.
DATASETS = {
    "bodies_25k": ["source=synthetic", "subjects=[0]", "target_vertices=25000"],
    "bodies_170k": ["source=synthetic", "subjects=[0]", "target_vertices=170000"],
    "animals_10k": ["source=animals", "target_vertices=10000"],
    "shapes_10k": ["source=shapes", "target_vertices=10000"],
}
#: Pose of a body for each kind of handles. Parts of the body touch in pose 7.
POSES = {"landmarks": 1, "regions": 4, "points": 7}
#: Two columns of cubes that touch at an edge.
TOUCHING = np.repeat(np.eye(2)[:, :, None], 3, axis=2)

Arrays = dict[str, np.ndarray]
Worker = subprocess.Popen[str]
#: Meshes with handles that need no dataset.
MESHES: dict[str, Callable[[], Arrays]] = {
    "bumpy_162": lambda: ends(shapes.bumpy(2)),
    "bumpy_2562": lambda: ends(shapes.bumpy(4)),
    "tube": lambda: ends(shapes.jittered(shapes.tube(24, 60), 0.02)),
    "genus_2": lambda: ends(shapes.double_torus(cells=4), axis=0),
    "non_manifold": lambda: ends(shapes.jittered(shapes.block(TOUCHING, cells=6), 0.01)),
    "one_sided": lambda: ends(moebius(120), axis=0),
    "40_components": lambda: components(40),
    "soft": lambda: ends(shapes.bumpy(4), weights=[np.inf, 10]),
    "turned": lambda: ends(shapes.bumpy(4), share=0.02, turned=True),
    "soft_turned": lambda: ends(shapes.bumpy(4), share=0.02, weights=[1, 100], turned=True),
    "dense": lambda: dense(shapes.bumpy(4)),
    "seam": lambda: without_groups(*shapes.torn(shapes.bumpy(4))[:2]),
    "with_eyes": lambda: with_eyes(shapes.bumpy(4)),
    "stretched": lambda: stretched(shapes.bumpy(4)),
}
#: Options of the cases of a mesh. Where handles are dense, older versions interpolate unless told otherwise.
OPTIONS: dict[str, dict[str, Any]] = {
    "40_components": {"warp": "never"},
    "dense": {"warp": "never"},
    "with_eyes": {"carry_unconstrained": True},
}


class Case(NamedTuple):
    """A mesh, a kind of :data:`tools.compare_worker.KINDS`, and options."""

    mesh: str
    kind: str
    options: dict[str, Any]

    @property
    def name(self) -> str:
        """The name in the table, and of the file with the result."""
        words = [f"{key}={value}".removeprefix("method=") for key, value in self.options.items()]
        return " ".join([self.mesh, self.kind, *words])


def all_cases(*, large: bool) -> Iterator[Case]:
    """Yield the cases."""
    bodies = [f"bodies_{size} {kind}" for size in ("25k", *["170k"] * large) for kind in POSES]
    others = [f"{dataset} {subject}" for dataset in ("animals_10k", "shapes_10k") for subject in range(4)]
    for mesh in (*bodies, *others, *(mesh for mesh in MESHES if mesh != "stretched")):
        for method in ("fast", "fine", "paper"):
            yield Case(mesh, "deform", {"method": method, **OPTIONS.get(mesh, {})})
    for mesh in ("bumpy_162", "animals_10k 0"):
        for method in ("fine_free", "paper_plain"):
            yield Case(mesh, "deform", {"method": method})
    yield Case("dense", "deform", {"method": "interpolate"})
    for mesh in ("bumpy_2562", "tube", "animals_10k 1"):
        for method in ("fast", "fine"):
            yield Case(mesh, "deform", {"method": method, "thickness": 1.0})
            yield Case(mesh, "deform", {"method": method, "bending": 0.01})
            if mesh != "tube":  # an open mesh has no volume
                yield Case(mesh, "deform", {"method": method, "volume_goal": 1.1})
    yield Case("bumpy_2562", "drag", {"method": "paper"})
    for mesh in ("bumpy_2562", *bodies):
        yield Case(mesh, "bind", {"method": "fast"})
        yield Case(mesh, "drag", {"method": "fast"})
    for mesh in ("bumpy_2562", "40_components", *bodies[3:4]):
        yield Case(mesh, "command", {"method": "fast", **OPTIONS.get(mesh, {})})
        yield Case(mesh, "command", {"method": "fine", "poses": 2, **OPTIONS.get(mesh, {})})
    for mesh in ("bumpy_2562", bodies[0]):
        yield Case(mesh, "remesh", {"vertices": 300})
    for samplings in (1, 10):
        yield Case("stretched", "transfer", {"samplings": samplings})


def arrays_of(mesh: str, data: Path) -> Arrays:
    """Return a mesh and its handles. Build the dataset if it is missing."""
    if mesh in MESHES:
        return MESHES[mesh]()
    dataset, which = mesh.split()
    if not (data / dataset / "dataset.json").exists():
        line = [sys.executable, "-m", "defaust", "build", f"out={data / dataset}", *DATASETS[dataset]]
        subprocess.run(line, check=True, cwd=ROOT)
    if which in POSES:
        task = load_task(data / dataset, subject=0, pose=POSES[which], handles=which)
    else:
        task = load_task(data / dataset, subject=int(which), pose=1)
    return joined(task.mesh, task.handles)


def joined(mesh: Mesh, handles: Handles) -> Arrays:
    """Return the arrays of a mesh and its handles."""
    arrays = {name: getattr(handles, name) for name in ("index", "target", "group", "weight", "rotation")}
    return {"V": mesh.V, "F": mesh.F} | {name: array for name, array in arrays.items() if array is not None}


def ends(mesh: Mesh, *, weights: Any = np.inf, turned: bool = False, **more: Any) -> Arrays:
    """Return a mesh with handles of :func:`tests.shapes.held_ends`, with one weight for each end.

    If `turned`, the handles also prescribe the rotations of the surface.
    """
    handles = shapes.held_ends(mesh, **more).handles
    if turned:
        handles = replace(handles, rotation=np.array([shapes.NO_TURN, shapes.QUARTER])[handles.group])
    return joined(mesh, replace(handles, weight=np.broadcast_to(weights, 2)[handles.group]))


def components(count: int) -> Arrays:
    """Return components in a row, each with handles at its ends."""
    meshes, handles = [], []
    for number in range(count):
        mesh, shift = shapes.jittered(shapes.bumpy(2), 0.02, seed=number), np.array([3.0 * number, 0, 0])
        own = shapes.held_ends(mesh).handles
        meshes.append(shapes.shifted(mesh, shift))
        handles.append((replace(own, target=own.target + shift), number * mesh.n))
    return joined(shapes.beside(*meshes), shapes.of_all(*handles))


def without_groups(V: np.ndarray, F: np.ndarray) -> Arrays:
    """Return a surface with 20 handles at each end along z, without groups."""
    used = np.unique(F)
    index = used[np.argsort(V[used, 2], kind="stable")][[*range(20), *range(-20, 0)]]
    return {"V": V, "F": F, "index": index, "target": V[index] + np.repeat([[0, 0, 0], [0.5, 0, 0.2]], 20, 0)}


def dense(mesh: Mesh) -> Arrays:
    """Return a mesh with handles at every fourth vertex."""
    index = np.arange(0, mesh.n, 4)
    return joined(mesh, Handles(index, shapes.bent(mesh.V)[index]))


def with_eyes(mesh: Mesh) -> Arrays:
    """Return a mesh with handles, and two components without handles near its upper end."""
    ball = Mesh(0.1 * shapes.icosphere(2).V, shapes.icosphere(2).F)
    whole = shapes.beside(mesh, *(shapes.shifted(ball, [x, 1.3, 0.8]) for x in (-0.3, 0.3)))
    return {**without_groups(mesh.V, mesh.F), "V": whole.V, "F": whole.F}


def stretched(mesh: Mesh) -> Arrays:
    """Return a mesh, its bent pose, and a stretched copy."""
    return {"V": mesh.V, "F": mesh.F, "posed": shapes.bent(mesh.V), "edited": mesh.V * [1.2, 1, 0.9]}


def difference(name: str, folders: tuple[Path, Path]) -> float:
    """Return the largest distance between two results; inf if one is missing or has another shape."""
    files = [folder / f"{name}.npy" for folder in folders]
    if not all(file.exists() for file in files):
        return np.inf
    first, second = map(np.load, files)
    return float(np.linalg.norm(first - second, axis=-1).max()) if first.shape == second.shape else np.inf


def limit(name: str) -> float:
    """Return the largest difference that a case may have."""
    return LIMIT_OF_FINE if "fine" in name else LIMIT


def started(tree: Path, python: Path, inputs: Path, outputs: Path) -> Worker:
    """Start a worker with the package of a tree."""
    line = [python, "-P", "-W", "ignore", ROOT / "tools" / "compare_worker.py", tree, inputs, outputs]
    environment, pipe = {**os.environ, "PYTHONPATH": str(tree)}, subprocess.PIPE
    return subprocess.Popen(line, stdin=pipe, stdout=pipe, text=True, env=environment)


def run(worker: Worker, case: Case) -> dict[str, float]:
    """Let a worker run a case, and return its ``seconds`` and its peak memory in ``kib``.

    The first run of a case also writes the result.
    """
    print(json.dumps({"name": case.name, **case._asdict()}), file=worker.stdin, flush=True)
    return json.loads(worker.stdout.readline() or sys.exit("a worker ended before its time"))


def compared(case: Case, workers: list[Worker], folders: list[Path], *, times: bool) -> list[float]:
    """Return the difference; with `times` also the seconds, and the ratios of times and of peak memory."""
    peaks = [run(worker, case)["kib"] for worker in workers]
    found = [difference(case.name, folders)]
    if times and np.isfinite(found[0]):
        turns = [[run(worker, case)["seconds"] for worker in workers] for _ in range(ROUNDS)]
        this, other = np.median(turns, axis=0)
        found += [this, this / other, peaks[0] / peaks[1]]
    return found


def compare(cases: list[Case], pythons: dict[Path, Path], data: Path, *, times: bool) -> int:
    """Print the table of all cases, and return the number of different results.

    Parameters
    ----------
    cases : list of Case
    pythons : dict
        Interpreter of each tree.
    data : path
        Folder of the datasets.
    times : bool
        Measure times and memory, too.
    """
    different = 0
    print(f"{'case':50} difference  limit" + " seconds    time  memory" * times)
    with TemporaryDirectory() as temporary:
        inputs, *folders = (Path(temporary) / name for name in ("inputs", "this", "other"))
        for folder in (inputs, *folders):
            folder.mkdir()
        for mesh in dict.fromkeys(case.mesh for case in cases):
            np.savez(inputs / f"{mesh}.npz", **arrays_of(mesh, data))
        # The peak memory of a case needs fresh processes.
        for together in [[case] for case in cases] if times else [cases]:
            with ExitStack() as stack:
                workers = []
                for (tree, python), folder in zip(pythons.items(), folders, strict=True):
                    workers.append(stack.enter_context(started(tree, python, inputs, folder)))
                for case in together:
                    found, *measured = compared(case, workers, folders, times=times)
                    differs = not found <= limit(case.name)
                    numbers = "".join(f"{number:8.3f}" for number in measured) + " differs" * differs
                    print(f"{case.name:50} {found:10.1e} {limit(case.name):6.0e}{numbers}", flush=True)
                    different += differs
    return different


def main() -> int:
    """Run the command; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.compare", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("other", type=Path, metavar="OTHER", help="folder of another clone")
    parser.add_argument("--python", type=Path, help="interpreter for OTHER (default: OTHER/.venv/bin/python)")
    parser.add_argument("--times", action="store_true", help="also measure times and peak memory")
    parser.add_argument("--large", action="store_true", help="add bodies of 170,000 vertices")
    parser.add_argument("--only", nargs="+", default=[""], metavar="NAME", help="cases with NAME in the name")
    data = "folder of the datasets, which are built if missing (default: data/compare)"
    parser.add_argument("--data", type=Path, default=ROOT / "data" / "compare", help=data)
    args = parser.parse_args()
    other = args.other.resolve()
    python = args.python or other / ".venv" / "bin" / "python"
    if other == ROOT or not (other / "sshade").is_dir() or not python.exists():
        parser.error(f"OTHER must be another clone, and {python} an interpreter")
    pythons = {ROOT: Path(sys.executable), other: python}
    cases = [case for case in all_cases(large=args.large) if any(name in case.name for name in args.only)]
    different = compare(cases, pythons, args.data.resolve(), times=args.times)
    print(f"{different} of {len(cases)} results differ")
    return int(different > 0)


if __name__ == "__main__":
    sys.exit(main())

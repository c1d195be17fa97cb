"""What remeshing keeps of the topology of a mesh: ``sshade-eval topology [MESH|FOLDER ...]``.

Remesh shapes to several numbers of samples and check what the proxy keeps: manifold,
consistently oriented, Euler characteristic, components, boundary loops, every sample used.
Prints a table; the exit code is 1 if any check fails.

Without arguments the built-in shapes are taken (tori, a tube, strips). A folder stands for
the rest poses in it (subject_*/rest.ply).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from eval.studies.shapes import double_torus, strip, torus, tube
from sshade.errors import InputError
from sshade.io.meshes import read_mesh
from sshade.mesh.mesh import Mesh
from sshade.sampling.remesh import proxy_mesh, remesh

SAMPLES = (200, 500, 1000, 3000, 6000)
COLUMNS = "mesh", "vertices", "samples", "added", "rounds", "euler", "components", "loops", "result"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "paths", nargs="*", type=Path, metavar="MESH|FOLDER", help="meshes, or dataset folders"
    )
    parser.add_argument("--samples", type=int, nargs="+", default=SAMPLES, metavar="K")
    parser.add_argument("--seed", type=int, default=0)


def command(options: argparse.Namespace) -> int:
    """Do it; return the exit code."""
    return _table(options.paths, options.samples, options.seed)


def check(mesh: Mesh, samples: int, *, seed: int = 0) -> dict[str, object]:
    """Remesh and compare; the row's ``result`` is ``ok`` or says what differs."""
    row: dict[str, object] = {"vertices": mesh.n, "samples": samples}
    try:
        remeshed = remesh(mesh, samples, seed=seed)
        proxy = proxy_mesh(mesh, remeshed)  # which refuses samples without a face
    except InputError as error:
        return {**row, "result": str(error)}
    differences = [
        name
        for name in mesh.topology._fields
        if getattr(mesh.topology, name) != getattr(proxy.topology, name)
    ]
    if not proxy.is_manifold:
        differences.append("not manifold")
    if not proxy.is_oriented:
        differences.append("orientation")
    return {
        **row,
        "added": remeshed.added,
        "rounds": remeshed.rounds,
        "euler": proxy.topology.euler,
        "components": proxy.topology.components,
        "loops": proxy.topology.boundary_loops,
        "result": "differs: " + ", ".join(differences) if differences else "ok",
    }


def _table(paths: Sequence[Path], samples: Sequence[int], seed: int) -> int:
    failures = rows = 0
    meshes = list(_named(paths) if paths else _built_in())
    print("  ".join(f"{name:>10}" for name in COLUMNS))  # noqa: T201
    for name, mesh in meshes:
        for count in (k for k in samples if k <= mesh.n):
            row = {"mesh": name, **check(mesh, count, seed=seed)}
            print("  ".join(f"{row.get(column, '')!s:>10}" for column in COLUMNS), flush=True)  # noqa: T201
            rows += 1
            failures += row["result"] != "ok"
    print(f"{rows - failures} of {rows} remeshings kept the topology")  # noqa: T201
    return 1 if failures else 0


def _named(paths: Sequence[Path]) -> Iterator[tuple[str, Mesh]]:
    for path in paths:
        if path.is_dir():
            files = sorted(path.glob("subject_*/rest.ply"))
            if not files:
                raise InputError(f"{path}: no subject_*/rest.ply in this folder")
            yield from ((file.parent.name, read_mesh(file)) for file in files)
        else:
            yield path.stem, read_mesh(path)


def _built_in() -> Iterator[tuple[str, Mesh]]:
    yield "torus", torus(200, 60)
    yield "2-torus", double_torus(3)
    yield "tube", tube(60, 200)
    for width in range(2, 9):
        yield f"strip-{width}", strip(width, 1500)

"""Whether proxies keep the topology of meshes: ``sshade-eval topology MESH|FOLDER ...``.

Sample proxies with several numbers of vertices and compare them with the mesh: manifold, consistently
oriented, Euler characteristic, components, boundary loops, every sample used. The command prints a table; its
exit code is 1 if a check fails. A folder stands for its rest poses (subject_*/rest.ply).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from sshade.errors import InputError
from sshade.io.meshes import read_surface
from sshade.mesh.mesh import Mesh
from sshade.sampling.proxy import proxy_mesh, sample_proxy

SAMPLES = (200, 500, 1000, 3000, 6000)
COLUMNS = "mesh", "vertices", "samples", "added", "rounds", "euler", "components", "loops", "result"


def check(mesh: Mesh, samples: int, *, seed: int = 0) -> dict[str, object]:
    """Sample a proxy and return the columns of its line. ``result`` is ``ok`` or names the differences."""
    line: dict[str, object] = {"vertices": mesh.n, "samples": samples}
    try:
        sampling = sample_proxy(mesh, samples, seed=seed)
        proxy = proxy_mesh(mesh, sampling)  # raises on samples without a face
    except InputError as error:
        return {**line, "result": str(error)}
    rest, kept = mesh.topology._asdict(), proxy.topology._asdict()
    differs = [name for name in rest if rest[name] != kept[name]]
    differs += [] if proxy.is_manifold else ["not manifold"]
    differs += [] if proxy.is_oriented else ["orientation"]
    line |= {"added": sampling.added, "rounds": sampling.rounds, "euler": kept["euler"]}
    line |= {"components": kept["components"], "loops": kept["boundary_loops"]}
    return {**line, "result": f"differs: {', '.join(differs)}" if differs else "ok"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("paths", nargs="+", type=Path, metavar="MESH|FOLDER", help="mesh or dataset folder")
    text = f"numbers of vertices of the proxies (default: {' '.join(map(str, SAMPLES))})"
    parser.add_argument("--samples", type=int, nargs="+", default=SAMPLES, metavar="K", help=text)
    parser.add_argument("--seed", type=int, default=0, help="seed of the sampling (default: 0)")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; exit code 1 if a check failed."""
    meshes = list(_meshes(options.paths))
    results = []
    print("  ".join(f"{name:>10}" for name in COLUMNS))  # noqa: T201
    for name, mesh in meshes:
        for count in (k for k in options.samples if k <= mesh.n):
            line = {"mesh": name, **check(mesh, count, seed=options.seed)}
            print("  ".join(f"{line.get(column, '')!s:>10}" for column in COLUMNS), flush=True)  # noqa: T201
            results.append(line["result"])
    print(f"{results.count('ok')} of {len(results)} proxies kept the topology")  # noqa: T201
    return int(any(result != "ok" for result in results))


def _meshes(paths: list[Path]) -> Iterator[tuple[str, Mesh]]:
    for path in paths:
        if not path.exists():
            raise InputError(f"{path}: there is no such mesh or folder")
        files = sorted(path.glob("subject_*/rest.ply")) if path.is_dir() else [path]
        if not files:
            raise InputError(f"{path}: no subject_*/rest.ply in this folder")
        yield from (
            (file.parent.name if path.is_dir() else file.stem, read_surface(file)[1].mesh) for file in files
        )

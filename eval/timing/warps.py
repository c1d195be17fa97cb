"""Dense handles: errors and times of methods on smooth maps of space, ``sshade-eval warps``.

A map moves every vertex of a mesh; random vertices are the handles, and the map is the ground truth
everywhere. By default the mesh is a bumpy ellipsoid of 655,362 vertices. Constants of the methods were chosen
on the maps `rigid`, `stretch`, `bend` and `grow`. The other maps are held out.

examples:
  sshade-eval warps
  sshade-eval warps --mesh body.ply --handles 500 --maps spiral shear \\
    --methods fast fine peer/rbf peer/biharmonic_coordinates elastic
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from eval.publish.markdown import markdown_table
from eval.rows.files import ROWS
from eval.rows.frame import to_frame, write_csv
from eval.run.warmup import icosphere
from eval.timing.cases import read_methods
from sshade.cli.console import progress_bar
from sshade.errors import InputError
from sshade.io.meshes import read_mesh
from sshade.mesh.mesh import Mesh
from sshade.task import DeformationTask, Handles

METHODS = ("fast", "elastic-fast=fast warp=never", "peer/rbf")
HANDLES = (10, 50, 200, 1000, 5000)
#: Subdivisions of an icosahedron for the default mesh, and for --quick.
LEVEL, QUICK_LEVEL = 8, 6


def rigid(x: np.ndarray) -> np.ndarray:
    """Turn by 60 degrees about an oblique axis."""
    turn = Rotation.from_rotvec(np.radians(60) * np.array([0.6, 0.0, 0.8]))
    return turn.apply(np.array(x)) + [0.3, 0.1, 0.0]


def stretch(x: np.ndarray) -> np.ndarray:
    """Stretch unevenly along the first axis."""
    return x * [1.0, 0.9, 0.95] + np.column_stack([0.25 * x[:, 0] * (1 + x[:, 0]), 0 * x[:, 0], 0 * x[:, 0]])


def bend(x: np.ndarray) -> np.ndarray:
    """Bend the first axis by 70 degrees."""
    return _bent(x, np.radians(70))


def grow(x: np.ndarray) -> np.ndarray:
    """Grow by 8.7 % of the volume, more at one end than at the other."""
    return x * (1.028 + 0.05 * np.sin(2.0 * x[:, :1]))


def twist(x: np.ndarray) -> np.ndarray:
    """Twist about the first axis, by 90 degrees from end to end."""
    return _twisted(x, np.radians(90))


def shear(x: np.ndarray) -> np.ndarray:
    """Shear, with waves across."""
    return x + np.column_stack([0.3 * x[:, 1], 0.05 * np.sin(5 * x[:, 0]), 0.1 * x[:, 0] ** 2])


def taper(x: np.ndarray) -> np.ndarray:
    """Taper towards one end."""
    return np.column_stack([x[:, 0], x[:, 1:] * (1 - 0.5 * x[:, :1])])


def spiral(x: np.ndarray) -> np.ndarray:
    """Bend by 45 degrees and twist by 60 degrees."""
    return _bent(_twisted(x, np.radians(60)), np.radians(45))


def _twisted(x: np.ndarray, angle: float) -> np.ndarray:
    """Twist about the first axis, of length 1."""
    a = angle * x[:, 0]
    y, z = x[:, 1], x[:, 2]
    return np.column_stack([x[:, 0], y * np.cos(a) - z * np.sin(a), y * np.sin(a) + z * np.cos(a)])


def _bent(x: np.ndarray, angle: float) -> np.ndarray:
    """Bend the first axis, of length 1, to an arc."""
    a, r = angle * x[:, 0], 1 / angle
    return np.column_stack([(r + x[:, 1]) * np.sin(a), (r + x[:, 1]) * np.cos(a) - r, x[:, 2]])


#: The maps of space by name, and the names of those that are held out.
MAPS = {f.__name__: f for f in (rigid, stretch, bend, grow, twist, shear, taper, spiral)}
HELD_OUT = ("twist", "shear", "taper", "spiral")


def ellipsoid(level: int) -> Mesh:
    """Return a bumpy ellipsoid of 10 * 4^level + 2 vertices."""
    ball = icosphere(level)
    bumps = 1 + 0.06 * np.sin(5 * ball.V[:, :1]) * np.cos(4 * ball.V[:, 1:2] + 3 * ball.V[:, 2:])
    return Mesh(ball.V * bumps * [0.5, 0.3, 0.25], ball.F)


def measure_warps(
    mesh: Mesh, methods: list[str], maps: list[str], handles: list[int], *, seed: int = 0
) -> list[dict[str, Any]]:
    """Run methods on maps; return a row for each map, number of handles, and method.

    Parameters
    ----------
    mesh : Mesh
        Rest shape; the maps act on the shape scaled to a diagonal of 1 around its centre.
    methods : list of str
        Texts of choices, see :func:`eval.configure.compose.read_choice`.
    maps : list of str
        Keys of :data:`MAPS`.
    handles : list of int
        Numbers of handles.
    seed : int
        Of the choice of handles.
    """
    timed, rows = read_methods(methods, blocks={}), []
    total = len(maps) * len(handles) * len(timed)
    low, high = mesh.V.min(axis=0), mesh.V.max(axis=0)
    mesh = Mesh((mesh.V - 0.5 * (low + high)) / np.linalg.norm(high - low), mesh.F)
    order = np.random.default_rng(seed).permutation(mesh.n)
    with progress_bar() as progress:
        for name in maps:
            truth = MAPS[name](mesh.V)
            for count in handles:
                index = order[:count]
                for method in timed:
                    progress("runs", len(rows), total, f"{name}, {method.label}")
                    task = DeformationTask(name, Mesh(mesh.V, mesh.F), Handles(index, truth[index]))
                    rows.append({"map": name, "held_out": name in HELD_OUT, "handles": count})
                    rows[-1] |= {"method": method.label, **_measured(method.on(task), mesh, truth)}
    return rows


def _measured(call: Callable[[], Any], mesh: Mesh, truth: np.ndarray) -> dict[str, Any]:
    """Call a method; return its errors in percent of the diagonal, and of a closed volume, and CPU time."""
    begin = process_time()
    try:
        result = call()
    except (InputError, FloatingPointError) as error:
        return {"failure": str(error)}
    seconds = process_time() - begin
    off = 100 * np.linalg.norm(result.vertices - truth, axis=1)
    facts = {"mean": off.mean(), "largest": off.max(), "cpu": seconds}
    facts["warped"] = result.extra.get("warped", 0.0)
    if mesh.is_closed and mesh.is_oriented:
        volume, true = (Mesh(V, mesh.F).volume for V in (result.vertices, truth))
        facts["volume"] = 100 * (volume / true - 1)
    return facts


def table(rows: list[dict[str, Any]]) -> str:
    """Return the table of rows in Markdown."""
    labels = ["map", "handles", "method", "mean error (%)", "largest (%)", "volume (%)"]
    labels += ["interpolated (%)", "CPU (s)"]
    body = []
    for row in rows:
        first = [row["map"] + (" (held out)" if row["held_out"] else ""), str(row["handles"]), row["method"]]
        if "failure" in row:
            body.append([*first, row["failure"], "", "", "", ""])
            continue
        volume = f"{row['volume']:+.3f}" if "volume" in row else "n/a"
        numbers = [f"{row['mean']:.5f}", f"{row['largest']:.4f}", volume]
        body.append([*first, *numbers, f"{100 * row['warped']:.0f}", f"{row['cpu']:.2f}"])
    return markdown_table(labels, body, left=("map", "method"))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--mesh", type=Path, help="rest shape (default: a bumpy ellipsoid)")
    text = "methods, each [LABEL=]NAME [KEY=VALUE ...] (default: " + ", ".join(METHODS) + ")"
    parser.add_argument("--methods", nargs="+", default=METHODS, metavar="METHOD", help=text)
    maps = {"choices": MAPS, "default": list(MAPS), "metavar": "MAP"}
    parser.add_argument("--maps", nargs="+", **maps, help=f"{', '.join(MAPS)} (default: all)")
    text = f"numbers of handles (default: {' '.join(map(str, HANDLES))})"
    parser.add_argument("--handles", nargs="+", type=int, default=HANDLES, metavar="N", help=text)
    text = "seed of the choice of handles (default: 0)"
    parser.add_argument("--seed", type=int, default=0, metavar="S", help=text)
    parser.add_argument("--quick", action="store_true", help="40,962 vertices instead of 655,362")


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    mesh = read_mesh(options.mesh) if options.mesh else ellipsoid(QUICK_LEVEL if options.quick else LEVEL)
    if min(options.handles) < 4 or max(options.handles) > mesh.n:
        raise InputError(f"--handles takes numbers from 4 to the number of vertices, {mesh.n}")
    if options.seed < 0:
        raise InputError(f"--seed takes a whole number from 0, not {options.seed}")
    rows = measure_warps(mesh, list(options.methods), options.maps, list(options.handles), seed=options.seed)
    print(table(rows))  # noqa: T201
    write_csv(ROWS.parent / "warps.csv", to_frame(rows))
    return 0

"""``python -m eval.timing``: how fast, and compared with what?"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from eval.run.provenance import environment
from eval.timing.drag import drag
from eval.timing.scaling import SIZES, scaling
from eval.timing.speed import speed
from eval.timing.startup import start_up
from sshade.cli.console import run_command
from sshade.io.handles import read_handles
from sshade.io.meshes import read_mesh
from sshade.task import DeformationTask

DESCRIPTION = """\
Time SShaDe on one mesh with handles: end to end and remeshing against libigl's Elastic,
against one full-resolution Cholesky factorisation, a drag once bound. Medians over repeats
that take turns in one process; compilation and input are outside the clock.

Elastic is timed over blocks of iterations and extrapolated to 1000; with --full it also runs
to its end under the tables' stopping rule, and the quality of the results is compared.

With --scaling, also one sampling on midpoint subdivisions of other meshes of the same
subject, up to 5 million vertices, each in a process of its own: for each of --sizes the
subdivision that comes nearest.

`make bench` builds the meshes and runs everything.

example:
  defaust build source=synthetic out=data/defaust_170k subjects=[0]
  python -m eval.timing data/defaust_170k/subject_00/rest.ply data/defaust_170k/subject_00/pose_1.json
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m eval.timing",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("mesh", type=Path, metavar="MESH")
    parser.add_argument("handles", type=Path, metavar="HANDLES")
    parser.add_argument("--vertices", type=int, default=6000, metavar="N", help="proxy vertices")
    parser.add_argument("--samplings", type=int, nargs="+", default=(5, 1), metavar="K")
    parser.add_argument("--repeats", type=int, default=7, metavar="R")
    parser.add_argument("--block", type=int, default=10, metavar="I", help="Elastic iterations a repeat")
    parser.add_argument("--full", action="store_true", help="also run Elastic to its end (minutes)")
    parser.add_argument(
        "--scaling", type=Path, nargs="+", default=(), metavar="BASE", help="meshes to subdivide"
    )
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES, metavar="N", help="sizes of --scaling")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="picture of the scaling (.png, .svg, .pdf)")
    return run_command(lambda: _bench(parser.parse_args(argv)))


def _bench(arguments: argparse.Namespace) -> int:
    mesh = read_mesh(arguments.mesh)
    task = DeformationTask(arguments.mesh.stem, mesh, read_handles(arguments.handles, mesh))
    _say(f"{arguments.mesh}: {mesh.n} vertices, {len(task.handles)} handles")
    _say(f"{environment(jobs=1)['machine']}; load {os.getloadavg()[0]:.1f} at the start")
    speed(
        task,
        _say,
        vertices=arguments.vertices,
        samplings=arguments.samplings,
        repeats=arguments.repeats,
        block=arguments.block,
        full=arguments.full,
    )
    start_up(_say, repeats=arguments.repeats)
    drag(task, _say, vertices=arguments.vertices)
    if arguments.scaling:
        scaling(
            arguments.scaling,
            arguments.handles,
            _say,
            vertices=arguments.vertices,
            repeats=3,
            sizes=arguments.sizes,
            plot=arguments.plot,
        )
    return 0


def _say(text: str) -> None:
    print(text, flush=True)  # noqa: T201


if __name__ == "__main__":
    sys.exit(main())

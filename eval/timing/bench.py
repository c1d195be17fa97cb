"""How fast, and compared with what: ``sshade-eval bench MESH HANDLES``.

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
  sshade-eval bench data/defaust_170k/subject_00/rest.ply data/defaust_170k/subject_00/pose_1.json
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from eval.run.provenance import environment
from eval.timing.drag import drag
from eval.timing.scaling import SIZES, scaling
from eval.timing.speed import speed
from eval.timing.startup import start_up
from eval.timing.timing import say
from sshade.io.handles import read_handles
from sshade.io.meshes import read_mesh
from sshade.task import DeformationTask


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
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


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    mesh = read_mesh(options.mesh)
    task = DeformationTask(options.mesh.stem, mesh, read_handles(options.handles, mesh))
    say(f"{options.mesh}: {mesh.n} vertices, {len(task.handles)} handles")
    say(f"{environment(jobs=1)['machine']}; load {os.getloadavg()[0]:.1f} at the start")
    speed(
        task,
        vertices=options.vertices,
        samplings=options.samplings,
        repeats=options.repeats,
        block=options.block,
        full=options.full,
    )
    start_up(repeats=options.repeats)
    drag(task, vertices=options.vertices)
    if options.scaling:
        scaling(
            options.scaling,
            options.handles,
            vertices=options.vertices,
            repeats=3,
            sizes=options.sizes,
            plot=options.plot,
        )
    return 0

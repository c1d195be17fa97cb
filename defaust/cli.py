"""The command ``defaust`` with its subcommands example, build and verify."""

from __future__ import annotations

import argparse
import logging
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from sshade.core.console import CommandParser, asked_help, mistakes_told, progress_bar, version_of
from sshade.core.errors import counted

EPILOG = """examples:
  defaust example DIR                                              a body with handles, to try sshade deform
  defaust build out=data/defaust                                   ten synthetic bodies, 170,000 vertices each
  defaust build source=synthetic out=DIR 'subjects=[0,1]' target_vertices=20000 seed=0
  defaust build source=new_bodies out=data/new_bodies              five other bodies in other poses
  defaust build source=noisy source.noise=2 out=data/noisy         the ten bodies with noise, in harder poses
  defaust build source=faust source.root=MPI-FAUST out=DIR         your own copy of FAUST
  defaust build source=tosca source.root=TOSCA_DIR 'source.classes=[cat,dog]' out=DIR
  defaust build source=sequence source.root=MESHES out=DIR         your own meshes in correspondence
  defaust build source=shapes out=data/shapes                      plane, cylinder, bar and cactus
  defaust build source=animals out=data/animals                    cat, horse, elephant and lizard
  defaust verify DIR"""

BUILD_EPILOG = """Arguments have the form key=value. All options and their defaults are in
conf/defaust/build.yaml, the options of a source in conf/defaust/source/NAME.yaml.
The most important options:
  source=NAME             synthetic (default), new_bodies, noisy, faust, tosca,
                          sequence, shapes or animals
  source.root=DIR         folder of your own meshes
  out=DIR                 folder to make, or to resume after an interruption
  subjects=[0,1]          subjects to build; default: all
  target_vertices=N       vertices of the high-resolution meshes; null keeps the registered meshes
  seed=N                  seed of the handles
  strict=false            leave out a mesh that cannot be used, instead of stopping at it
  workers=N               processes; does not change the result"""

#: Extra that brings a library, by the module that is imported.
EXTRAS = dict.fromkeys(("igl", "pymeshlab", "hydra", "omegaconf"), "bench")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return 0 on success, 1 if verify finds faults, 2 on bad input."""
    with mistakes_told(extras=EXTRAS) as end:
        args = make_parser().parse_args(asked_help(sys.argv[1:] if argv is None else argv))
        logging.basicConfig(format="%(message)s")
        command = {"example": _example, "build": _build, "verify": _verify}[args.command]
        end.code = command(args)
    return end.code


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog="defaust",
        description="Build and check DeFAUST, a benchmark for the deformation of large meshes.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=version_of("defaust"))
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    example = commands.add_parser(
        "example",
        help="write a body with handles, to try sshade deform",
        description="Write the mesh rest.ply, handle files of three poses, and the true mesh of each pose. "
        "Files of the same names are replaced.",
    )
    example.add_argument("folder", type=Path, metavar="DIR", help="folder to make")
    example.add_argument(
        "--subdivisions",
        type=int,
        choices=range(6),
        default=2,
        help="0 gives 6,890 vertices, and each step four times as many (default: 2, 110,210 vertices)",
    )
    build = commands.add_parser(
        "build",
        help="build a dataset, or resume a build",
        description="Build a dataset, or resume an interrupted build.",
        epilog=BUILD_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    build.add_argument("overrides", nargs="+", metavar="key=value", help="options of the build, see below")
    text = "check every file of a dataset"
    verify = commands.add_parser("verify", help=text, description=f"{text.capitalize()}.")
    verify.add_argument("folder", type=Path, metavar="DIR", help="folder of the dataset")
    return parser


def _example(args: argparse.Namespace) -> int:
    from defaust.example import POSES, write_example
    from defaust.folder.layout import REST

    replaced = "replaced, " if (args.folder / REST).is_file() else ""
    rest = write_example(args.folder, subdivisions=args.subdivisions)
    mesh, handles = ((args.folder / name).as_posix() for name in (REST, f"pose_{POSES[1]}.json"))
    command = shlex.join(["sshade", "deform", mesh, handles, "-o", "posed.ply"])
    print(f"{mesh}: {replaced}{rest.n:,} vertices; try: {command}")  # noqa: T201
    return 0


def _build(args: argparse.Namespace) -> int:
    from defaust.build.dataset import build
    from defaust.configuration import configure

    request = configure(args.overrides)
    with progress_bar() as progress:
        document = build(
            request.source,
            request.out,
            options=request.options,
            strict=request.strict,
            workers=request.workers,
            progress=progress,
        )
    counts = ", ".join(f"{s['high']['vertices']:,}" for s in document["subjects"])
    number = len(document["subjects"])
    poses = ", ".join(document["source"].get("rest_poses", []))
    rest = f", at rest: {poses}" if poses else ""
    print(f"{request.out}: {counted(number, 'subject', 'subjects')} ({counts} vertices){rest}")  # noqa: T201
    return 0


def _verify(args: argparse.Namespace) -> int:
    from defaust.folder.record import read_dataset

    read_dataset(args.folder, intact=False)  # refuses another folder before the next import, which is slow
    from defaust.build.verify import verify

    with progress_bar() as progress:
        faults = verify(args.folder, progress=progress)
    for fault in faults:
        print(f"{fault.file}: {fault.text}")  # noqa: T201
    files = len({fault.file for fault in faults})
    found = f"{counted(files, 'file is', 'files are')} damaged" if faults else "every file is as listed"
    print(f"{args.folder}: {found}")  # noqa: T201
    return 1 if faults else 0

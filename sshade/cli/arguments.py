"""Arguments that several sub-commands of ``sshade`` have, and what they do with files."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import get_args

from sshade.carry.kinds import FrameKind
from sshade.cli.console import say
from sshade.io.document import MeshFile
from sshade.io.meshes import SUFFIXES, read_file
from sshade.pipeline.proxies import VERTICES

#: What `--help` says of a mesh.
FORMATS = ", ".join(SUFFIXES)


def add_files(parser: argparse.ArgumentParser, *, output: str, **positional: str) -> None:
    """Paths by name with what they are, and the -o that is called `output`."""
    for name, text in positional.items():
        parser.add_argument(name, type=Path, metavar=name.upper(), help=text)
    parser.add_argument("-o", "--output", type=Path, required=True, metavar=output, help="mesh to write")


def add_samplings(parser: argparse.ArgumentParser, *, default: int | None) -> None:
    usual = "the method's own" if default is None else f"{default}, as the paper"
    parser.add_argument(
        "--samplings", type=int, default=default, metavar="K", help=f"proxies averaged (default: {usual})"
    )
    parser.add_argument("--workers", type=int, metavar="W", help="threads (default: two a processor)")


def add_frames(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--frames",
        choices=get_args(FrameKind),
        default="triangle",
        help="what carries the mesh along: rigid frames of the proxy's triangles, as the paper, their "
        "affine maps, or frames at the proxy's vertices, blended (default: triangle)",
    )


def add_vertices(
    parser: argparse.ArgumentParser, *, default: int | None = VERTICES, text: str = str(VERTICES)
) -> None:
    parser.add_argument(
        "--vertices",
        type=int,
        default=default,
        metavar="N",
        help=f"proxy vertices, a quarter of the mesh's at most (default: {text})",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the sampling (default: 0)")


def read(path: Path, output: Path) -> MeshFile:
    """A mesh file; what `output` cannot take over of it is said."""
    file = read_file(path)
    if lost := file.lost(output):
        say(f"note: {output} keeps no {' or '.join(lost)} of {path}: it is of another format")
    return file

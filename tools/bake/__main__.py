"""The command: ``python -m tools.bake ASSET [--mpfb2 DIR] --out FILE``."""

from __future__ import annotations

import argparse
import hashlib
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import tools.bake
from sshade import InputError
from sshade.core.console import mistakes_told
from sshade.core.whole_files import replacing
from tools.bake import animals, bodies, new_bodies, noisy

ASSETS = {"bodies": bodies.bake, "new_bodies": new_bodies.bake, "noisy": noisy.bake, "animals": animals.bake}


def main(argv: Sequence[str] | None = None) -> int:
    """Bake an asset and write it, and print its checksum."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        "python -m tools.bake", description=tools.bake.__doc__, formatter_class=raw
    )
    parser.add_argument("asset", choices=ASSETS)
    parser.add_argument("--mpfb2", type=Path, help="folder of MPFB2's data, with 3dobjs, rigs and targets")
    parser.add_argument("--out", type=Path, required=True, help="the .npz to write")
    args = parser.parse_args(argv)
    with mistakes_told() as end:
        if args.mpfb2 is not None and not (args.mpfb2 / "3dobjs" / "base.obj").is_file():
            raise InputError(f"{args.mpfb2}: holds no 3dobjs/base.obj; give the folder of MPFB2's data")
        if args.asset == "new_bodies" and args.mpfb2 is None:
            raise InputError("new_bodies needs --mpfb2, the folder of MPFB2's data")
        arrays = ASSETS[args.asset](args.mpfb2)
        with replacing(args.out) as temporary:
            np.savez_compressed(temporary, **arrays)
        data = args.out.read_bytes()
        print(f"{args.out}: {len(data)} bytes, sha256 {hashlib.sha256(data).hexdigest()}")
    return end.code


if __name__ == "__main__":
    sys.exit(main())

"""``python -m defaust.bake.scans --meshes DIR --out DIR``: make the assets of the scans.

DIR holds koala.ply, cat.ply and hand.ply as https://github.com/odedstein/meshes has them; NOTICE names their
authors. Only whoever changes the assets runs it.
"""

from __future__ import annotations

import argparse
import hashlib
import logging
import sys
from pathlib import Path

import numpy as np

from defaust.sources.packing import pack
from defaust.sources.scans import SHIPPED
from sshade.cli.console import run_command
from sshade.io.files import replacing
from sshade.io.meshes import read_mesh

log = logging.getLogger("defaust.bake")


def main(argv: list[str] | None = None) -> int:
    """Parse the command line, pack each scan, and write its asset."""
    parser = argparse.ArgumentParser(prog="python -m defaust.bake.scans", description=__doc__)
    parser.add_argument("--meshes", type=Path, required=True, help="folder of the meshes")
    parser.add_argument("--out", type=Path, required=True, help="folder of the .npz to write")
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(message)s")

    def work() -> int:
        for name in SHIPPED:
            path = args.out / f"{name}.npz"
            arrays = pack(read_mesh(args.meshes / f"{name}.ply"))
            with replacing(path) as temporary:
                np.savez_compressed(temporary, **arrays)
            data = path.read_bytes()
            log.info("%s: %d bytes, sha256 %s", path, len(data), hashlib.sha256(data).hexdigest())
        return 0

    return run_command(work)


if __name__ == "__main__":
    sys.exit(main())

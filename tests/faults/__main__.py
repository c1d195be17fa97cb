"""Kill builds and sweeps at random moments: ``python -m tests.faults --kills 100``."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from tests.faults.disturb import kill_at_random, two_at_once, undisturbed
from tests.faults.scenes import SCENES


def main() -> int:
    """Print what was survived; an AssertionError ends it otherwise."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    parser.add_argument("--kills", type=int, default=100, help="in all (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    each = -(-options.kills // len(SCENES))
    for scene in SCENES.values():
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            expected, seconds = undisturbed(scene, folder)
            kill_at_random(scene, folder, kills=each, expected=expected, seconds=seconds, seed=options.seed)
            codes = two_at_once(scene, folder, expected=expected)
        print(  # noqa: T201
            f"{scene.name}: {each} kills in {seconds:.1f} s of work survived; two at once ended with {codes}",
            flush=True,
        )
    print(f"{each * len(SCENES)} kills survived")  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main())

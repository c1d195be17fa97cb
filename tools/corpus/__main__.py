"""Try every method on a corpus of mesh files, and check each result without code of the package.

``python -m tools.corpus`` writes about 430 files of many kinds into a temporary folder, makes handles for
each, runs ``sshade deform``, and prints what was deformed, what was refused and why, and what is wrong. The
exit code is 1 if anything is wrong. ``--own FOLDER`` does the same for all mesh files of a folder.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter

from tools.corpus.cases import cases
from tools.corpus.report import report
from tools.corpus.run import try_named, try_own

METHODS = ("fast", "fine", "paper")
SUFFIXES = (".ply", ".obj", ".off", ".stl", ".glb", ".gltf")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.corpus", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument(
        "--own", type=Path, metavar="FOLDER", help="try the mesh files of this folder instead"
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="keep the files of the corpus and all results there"
    )
    parser.add_argument("--methods", nargs="+", default=METHODS, choices=METHODS)
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="number of processes (default: 2)")
    parser.add_argument(
        "--only", nargs="+", metavar="NAME", help="only cases whose names contain one of these"
    )
    parser.add_argument("--list", action="store_true", help="print the names of the cases, and stop")
    options = parser.parse_args(argv)
    chosen = [c for c in cases() if not options.only or any(word in c.name for word in options.only)]
    if options.list:
        print("\n".join(case.name for case in chosen))
        return 0
    files = sorted(p for p in options.own.rglob("*") if p.suffix.lower() in SUFFIXES) if options.own else []
    if options.own and not files:
        parser.error(f"{options.own} holds no mesh files ({', '.join(SUFFIXES)})")
    begin = perf_counter()
    with tempfile.TemporaryDirectory() as temporary:
        folder, keep = options.out or Path(temporary), options.out is not None
        folder.mkdir(parents=True, exist_ok=True)
        with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
            if options.own:
                names = [(p.resolve(), str(p.relative_to(options.own))) for p in files]
                jobs = [pool.submit(try_own, *n, options.methods, folder, keep=keep) for n in names]
            else:
                jobs = [pool.submit(try_named, c.name, options.methods, folder, keep) for c in chosen]
            outcomes = [outcome for job in jobs for outcome in job.result()]
    print(report(outcomes, options.methods))
    print(f"{perf_counter() - begin:.0f} s")
    return int(any(outcome.verdict == "wrong" for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main())

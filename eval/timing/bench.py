"""Measure times: ``sshade-eval bench KIND --methods ... --cases ...`` writes a line a repeat.

Methods take turns (A B C A B C ...), after a warm-up, on a machine that is quiet: a repeat during
which other processes used more than 5 % of its cores, or a clock jumped, is thrown away and
repeated; after five in a row the command ends and writes nothing. Repeats last a second at least,
in several calls where one is shorter; what takes over a minute is called once.

kinds:
  speed    calls of methods on tasks; those of --extrapolate run --block iterations, from which
           the time of their cutoff is computed
  drag     methods that can be bound: bind, first solve, steps of a drag, the way back; with
           --sizes on subdivisions of the cases, as scaling
  scaling  midpoint subdivisions of the cases, for each of --sizes the one that comes nearest,
           each in a process of its own, with its peak of memory
  whole    `sshade deform --method METHOD` from start to end, files included; without cases on a tiny
           mesh: imports for the most part; with --sizes on subdivisions of the cases, as scaling

A method or a case is [LABEL=]NAME [KEY=VALUE ...], a name of conf/method or conf/dataset and its
settings; with a dot, one of the whole configuration, as for `sshade-eval run`.

examples:
  sshade-eval bench speed --methods elastic sshade_fast "sshade-1=sshade samplings=1" \\
    --cases "mesh mesh=body.ply handles=pose.json" --extrapolate elastic
  sshade-eval bench drag --methods "sshade-1=sshade samplings=1 solver.start=rest" \\
    --cases "defaust root=data/defaust_170k subject=0 pose=1,2"
  sshade-eval timings speed drag
"""

from __future__ import annotations

import argparse
import re

from eval.rows.frame import to_frame, write_csv
from eval.run.provenance import require_unchanged
from eval.timing import drag, scaling, speed, whole
from eval.timing.cases import read_cases, read_methods
from eval.timing.table import TIMING, require_free
from sshade.errors import InputError

KINDS = (speed.KIND, drag.KIND, scaling.KIND, whole.KIND)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("kind", choices=KINDS, metavar="KIND", help=", ".join(KINDS))
    parser.add_argument("--methods", nargs="+", required=True, metavar="METHOD")
    parser.add_argument("--cases", nargs="+", default=(), metavar="CASE")
    parser.add_argument("--name", help=f"of the CSV in {TIMING} (default: KIND)")
    parser.add_argument("--rounds", type=int, default=3, metavar="R", help="kept repeats (default: 3)")
    parser.add_argument("--extrapolate", nargs="+", default=(), metavar="LABEL", help="methods, for speed")
    parser.add_argument("--block", type=int, default=10, metavar="I", help="iterations (default: 10)")
    parser.add_argument(
        "--sizes", type=int, nargs="+", default=(), metavar="N", help="vertices, not for speed"
    )


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    name = options.name or options.kind
    _check(options, name)
    sources = read_cases(options.cases)
    if options.kind == whole.KIND:
        rows = whole.time_commands(options.methods, sources, rounds=options.rounds, sizes=options.sizes)
    else:
        methods = read_methods(options.methods)
        if options.kind == drag.KIND:
            rows = drag.time_drags(methods, sources, rounds=options.rounds, sizes=options.sizes)
        elif options.kind == scaling.KIND:
            rows = scaling.time_scaling(
                methods, sources, rounds=options.rounds, sizes=options.sizes or scaling.SIZES
            )
        else:
            rows = speed.time_methods(
                methods,
                sources,
                rounds=options.rounds,
                extrapolated=options.extrapolate,
                block=options.block,
            )
    require_unchanged(())
    path = TIMING / f"{name}.csv"
    write_csv(path, to_frame(rows))
    lost = sum(not row["kept"] for row in rows)
    print(f"{path}: repeats kept {len(rows) - lost}, thrown away {lost}; `sshade-eval timings {name}`")  # noqa: T201
    return 0


def _check(options: argparse.Namespace, name: str) -> None:
    """Raise InputError on arguments that do not go together."""
    if not re.fullmatch(r"[\w.+=-]+", name):
        raise InputError(f"--name {name!r} is no name of a file; use letters, digits and _.+=-")
    if min(options.rounds, *options.sizes, 1) < 1:
        raise InputError("--rounds and --sizes take numbers from 1")
    if not options.cases and (options.kind != whole.KIND or options.sizes):
        raise InputError(f"{options.kind} needs --cases; `sshade-eval bench --help` tells more")
    if options.extrapolate and options.kind != speed.KIND:
        raise InputError(f"{options.kind} takes no --extrapolate, which is for {speed.KIND}")
    require_free(name)

"""Measure times: ``sshade-eval bench KIND --methods ... --cases ...`` writes one line per repeat.

Methods take turns (A B C A B C ...), after a warm-up. A repeat counts only on a quiet machine: it is
rejected and run again if other processes used more than 5 % of the cores, or a clock jumped. After five
rejected repeats in a row the command ends and writes nothing. A repeat lasts at least a second; shorter
calls run several times in a repeat. A call of more than a minute runs once.

kinds:
  speed    calls of methods on tasks; the methods of --extrapolate run --block iterations, from which
           the time of their cutoff is estimated
  drag     methods that can be bound: bind, first solve, steps of a drag, the way back
  scaling  subdivided meshes, each in a new process, with the peak of its memory
  whole    `sshade deform --method METHOD` from start to end, with files and imports; without cases on a
           tiny mesh

With --sizes, the cases are replaced by their midpoint subdivisions with the nearest numbers of vertices.
A method or a case is [LABEL=]NAME [KEY=VALUE ...], with NAME in conf/method or conf/dataset. A KEY with a dot
is a setting of the whole configuration, as for `sshade-eval run`.

examples:
  sshade-eval bench speed --methods elastic fast "paper-1=paper samplings=1" \\
    --cases "mesh mesh=body.ply handles=pose.json" --extrapolate elastic
  sshade-eval bench drag --methods "paper-1=paper samplings=1 solver.start=rest" \\
    --cases "defaust root=data/defaust_170k subject=0 pose=1,2"
  sshade-eval timings speed drag
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable

from eval.rows.files import TIMING
from eval.rows.frame import to_frame, write_csv
from eval.rows.store import Row
from eval.timing.drag import time_drags
from eval.timing.scaling import SIZES, time_scaling
from eval.timing.speed import time_methods
from eval.timing.table import require_free
from eval.timing.timed_cases import read_cases, read_methods
from eval.timing.turns import DRAG, SCALING, SPEED, WHOLE
from eval.timing.whole import time_commands
from sshade.core.errors import InputError

#: Function that times the methods of a kind.
KINDS: dict[str, Callable[..., list[Row]]] = {
    SPEED: time_methods,
    DRAG: time_drags,
    SCALING: time_scaling,
    WHOLE: time_commands,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("kind", choices=KINDS, metavar="KIND", help=", ".join(KINDS))
    parser.add_argument("--methods", nargs="+", required=True, metavar="METHOD", help="methods, see above")
    parser.add_argument("--cases", nargs="+", default=(), metavar="CASE", help="cases, see above")
    parser.add_argument("--name", help=f"name of the CSV in {TIMING} (default: KIND)")
    parser.add_argument("--rounds", type=int, default=3, metavar="R", help="accepted repeats (default: 3)")
    text = "methods whose time is estimated, for speed"
    parser.add_argument("--extrapolate", nargs="+", default=(), metavar="LABEL", help=text)
    text = "iterations that methods of --extrapolate run (default: 10)"
    parser.add_argument("--block", type=int, default=10, metavar="I", help=text)
    text = "numbers of vertices to which the cases are subdivided"
    parser.add_argument("--sizes", type=int, nargs="+", default=(), metavar="N", help=text)


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    kind, name, methods = options.kind, options.name or options.kind, options.methods
    _check(options, name)
    cases = read_cases(options.cases, sizes=options.sizes or (SIZES if kind == SCALING else ()))
    if kind != WHOLE:  # takes the texts of methods
        methods = read_methods(methods, blocks=dict.fromkeys(options.extrapolate, options.block))
    rows = KINDS[kind](methods, cases, rounds=options.rounds)
    path = TIMING / f"{name}.csv"
    write_csv(path, to_frame(row | {"kind": kind} for row in rows))
    lost = sum(not row["kept"] for row in rows)
    print(f"{path}: repeats kept {len(rows) - lost}, rejected {lost}; `sshade-eval timings {name}`")  # noqa: T201
    return 0


def _check(options: argparse.Namespace, name: str) -> None:
    """Raise InputError on arguments that do not go together."""
    if not re.fullmatch(r"[\w.+=-]+", name):
        raise InputError(f"--name {name!r} is no name of a file; use letters, digits and _.+=-")
    if min(options.rounds, *options.sizes, 1) < 1:
        raise InputError("--rounds and --sizes take numbers from 1")
    if not options.cases and (options.kind != WHOLE or options.sizes):
        raise InputError(f"{options.kind} needs --cases; see `sshade-eval bench --help`")
    if options.extrapolate and options.kind != SPEED:
        raise InputError(f"{options.kind} takes no --extrapolate, which is for {SPEED}")
    require_free(name)

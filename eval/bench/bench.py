"""Measure times: ``sshade-eval bench KIND --methods ... --cases ...`` writes one row per repeat, and a table.

Methods take turns (A B C A B C ...), after a warm-up. A repeat is run again if other processes used more than
5 % of the cores. After five such repeats in a row the command ends and writes nothing.

kinds:
  speed    calls of methods; those of --extrapolate run 10 iterations, from which the full time is estimated
  drag     methods that can be bound: bind, first solve, steps of a drag, the way back
  scaling  subdivided meshes, each in a new process, with the peak of its memory
  whole    `sshade deform` with files and imports; without cases on a tiny mesh

A method or a case is [LABEL=]NAME [KEY=VALUE ...], with NAME in conf/method or conf/dataset. A KEY with a dot
is a setting of the whole configuration. --sizes replaces cases by their subdivisions with about N vertices.

  sshade-eval bench speed --methods elastic fast "paper-1=paper samplings=1" \\
    --cases "mesh mesh=body.ply handles=pose.json" --extrapolate elastic
  sshade-eval bench drag --methods "paper-1=paper samplings=1 solver.start=rest" \\
    --cases "defaust root=data/defaust_170k subject=0 pose=1,2"
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from eval.bench.jobs import TimedCase, TimedMethod, time_calls, time_commands, time_drags, time_scaling
from eval.bench.table import DRAG, SCALING, SPEED, WHOLE, write_tables
from eval.rows.files import TIMING
from eval.rows.frame import to_frame, write_csv
from eval.rows.store import Row
from eval.run.config import check_root, one_each, read_choice, resolved, source_of, task_of
from sshade.core.errors import InputError

#: Function that times the methods of a kind.
KINDS: dict[str, Callable[..., list[Row]]] = {
    SPEED: time_calls,
    DRAG: time_drags,
    SCALING: time_scaling,
    WHOLE: time_commands,
}
#: Numbers of vertices of the kind scaling by default, and largest number of subdivisions of a case.
SIZES = (10_000, 30_000, 100_000, 300_000, 450_000, 1_000_000, 3_000_000, 5_000_000)
DEEPEST = 5


def read_methods(texts: Iterable[str], *, extrapolate: Sequence[str]) -> list[TimedMethod]:
    """Resolve the choices of methods.

    Raises
    ------
    InputError
        If a choice cannot be resolved, two methods have the same label, or none has a label of `extrapolate`.
    """
    choices = [read_choice(text) for text in texts]
    labels = [choice.label for choice in choices]
    if twice := [label for label in labels if labels.count(label) > 1]:
        raise InputError(f"two methods are named {twice[0]!r}; name one of them LABEL={twice[0]}")
    if unknown := [label for label in extrapolate if label not in labels]:
        raise InputError(f"--extrapolate names {unknown[0]}, which is none of the methods")
    return [TimedMethod(c.label, resolved("method", c), c.label in extrapolate) for c in choices]


def read_cases(texts: Iterable[str], *, sizes: Sequence[int]) -> list[TimedCase]:
    """Resolve the choices of datasets; with `sizes`, to their subdivisions with about so many vertices.

    Raises
    ------
    InputError
        If a choice cannot be resolved, or the dataset is missing.
    """
    sources = []
    for choice in [one for text in texts for one in one_each(read_choice(text))]:
        config = resolved("dataset", choice)
        check_root(config)
        sources.append(source_of(config))
    if not sizes:
        return [TimedCase(source) for source in sources]
    counts = [task_of(source, truth=False).mesh.n for source in sources]
    levels = [(4**level * n, i, level) for i, n in enumerate(counts) for level in range(DEEPEST + 1)]
    nearest = {min(levels, key=lambda case: abs(np.log(case[0] / size))) for size in sizes}
    return [TimedCase(sources[i], level) for _, i, level in sorted(nearest)]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("kind", choices=KINDS, metavar="KIND", help=", ".join(KINDS))
    parser.add_argument("--methods", nargs="+", required=True, metavar="METHOD", help="methods, see above")
    parser.add_argument("--cases", nargs="+", default=(), metavar="CASE", help="cases, see above")
    parser.add_argument("--name", help="name of the rows and of the table (default: KIND)")
    parser.add_argument("--rounds", type=int, default=3, metavar="R", help="accepted repeats (default: 3)")
    text = "methods whose time is estimated, for speed"
    parser.add_argument("--extrapolate", nargs="+", default=(), metavar="LABEL", help=text)
    text = "numbers of vertices to which the cases are subdivided"
    parser.add_argument("--sizes", type=int, nargs="+", default=(), metavar="N", help=text)
    text = "folder of timing and tables (default: out)"
    parser.add_argument("-o", "--out", type=Path, default=TIMING.parent, help=text)


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    kind, name = options.kind, options.name or options.kind
    if not re.fullmatch(r"[\w.+=-]+", name):
        raise InputError(f"--name {name!r} is no name of a file; use letters, digits and _.+=-")
    if min(options.rounds, *options.sizes, 1) < 1:
        raise InputError("--rounds and --sizes take numbers from 1")
    if not options.cases and (kind != WHOLE or options.sizes):
        raise InputError(f"{kind} needs --cases; see `sshade-eval bench --help`")
    if options.extrapolate and kind != SPEED:
        raise InputError(f"{kind} takes no --extrapolate, which is for {SPEED}")
    cases = read_cases(options.cases, sizes=options.sizes or (SIZES if kind == SCALING else ()))
    methods = (
        options.methods if kind == WHOLE else read_methods(options.methods, extrapolate=options.extrapolate)
    )
    rows = to_frame(row | {"kind": kind} for row in KINDS[kind](methods, cases, rounds=options.rounds))
    path = options.out / TIMING.name / f"{name}.csv"
    write_csv(path, rows)
    print(f"{path}: repeats kept {rows['kept'].sum()} of {len(rows)}\n")  # noqa: T201
    print(write_tables(rows, options.out / "tables" / name))  # noqa: T201
    return 0

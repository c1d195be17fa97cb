"""The command ``sshade-eval``: one program with a sub-command for each step of an evaluation.

The module of a sub-command gives its description (the module's docstring),
``add_arguments(parser)`` and ``command(options) -> exit code``; it is imported
only when it is asked for. ``run`` alone is a Hydra program, which reads its
arguments itself.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module

PROGRAM = "sshade-eval"


#: Sub-command -> the module that does it, and what it does in one line.
COMMANDS = {
    "run": ("eval.configure.app", "run methods on tasks, once or as a sweep (-m); a Hydra program"),
    "status": ("eval.run.status", "how far the sweeps are"),
    "collect": ("eval.rows.collect", "gather the rows of finished runs into one CSV an experiment"),
    "tables": ("eval.publish.tables", "tables from rows: CSV, Markdown and LaTeX"),
    "charts": ("eval.publish.charts", "distributions, convergence"),
    "figures": ("eval.publish.figures", "the comparison picture: rest shapes and results"),
    "curves": ("eval.publish.curves", "metrics against a size or a parameter"),
    "front": ("eval.publish.front", "volume against stretch"),
    "report": ("eval.publish.report.command", "one HTML page with all of it and a 3D view"),
    "publish": ("eval.publish.publish", "an experiment's rows, tables and figures into results/"),
    "remeasure": ("eval.run.remeasure", "metrics of finished runs, from their stored vertices"),
    "compare": ("eval.rows.compare", "whether two sets of rows say the same"),
    "check": ("eval.rows.bands", "hold rows against committed bands of quality"),
    "bench": ("eval.timing.bench", "times of methods in turns, on a machine that is quiet"),
    "timings": ("eval.timing.table", "tables of the times that bench wrote"),
    "jumps": ("eval.studies.jumps", "jumps of the deformation across the proxy's edges"),
    "topology": ("eval.studies.topology", "what remeshing keeps of a mesh's topology"),
}

HELP = f"""\
Run deformation methods, and make tables, figures and pages of what they left.

{{commands}}

  {PROGRAM} run method=sshade dataset=defaust dataset.root=DIR subject=0 pose=1
  {PROGRAM} run -m experiment=quick
  {PROGRAM} collect quick && {PROGRAM} tables quick && {PROGRAM} report quick

`{PROGRAM} COMMAND --help` tells more. Exit codes: 0; 1 where a run failed or a check did not
hold; 2 for a mistake in the arguments, told in one sentence.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments and arguments[0] in ("-h", "--help"):
        lines = (f"  {name:<10} {summary}" for name, (_, summary) in COMMANDS.items())
        print(HELP.format(commands="\n".join(lines)), end="")  # noqa: T201
        return 0
    try:
        from sshade.cli.console import run_command

        return run_command(lambda: call(arguments[0] if arguments else "", arguments[1:]))
    except KeyboardInterrupt:  # while the libraries are read
        print("interrupted", file=sys.stderr)  # noqa: T201
        return 130


def call(name: str, arguments: Sequence[str]) -> int:
    """Run a sub-command.

    Parameters
    ----------
    name : str
        A key of :data:`COMMANDS`.
    arguments : sequence of str

    Returns
    -------
    int
        The exit code.

    Raises
    ------
    InputError
        On a mistake in the arguments or in what they name.
    """
    if name not in COMMANDS:
        from sshade.errors import InputError

        found = f"{name!r} is no command" if name else "a command is missing"
        raise InputError(f"{found}; {PROGRAM} takes one of {', '.join(COMMANDS)}")
    module = import_module(COMMANDS[name][0])
    if name == "run":
        sys.argv[:] = [f"{PROGRAM} run", *arguments]  # where Hydra reads them
        return module.main()
    from sshade.cli.console import CommandParser

    parser = CommandParser(
        prog=f"{PROGRAM} {name}",
        description=module.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    module.add_arguments(parser)
    return module.command(parser.parse_args(arguments))

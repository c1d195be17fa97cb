"""The command ``sshade-eval``: a program with a sub-command for each step of an evaluation.

See :mod:`sshade.core.console`. The sub-command ``run`` is a Hydra program and reads its arguments itself.
"""

from __future__ import annotations

import os

from eval.installation import EXTRAS
from sshade.core.console import Program

# Runs ask git for the state of the checkout. This variable keeps git from locking and writing its index.
os.environ.setdefault("GIT_OPTIONAL_LOCKS", "0")

#: Sub-command -> its module, and a description in one line.
COMMANDS = {
    "run": ("eval.configure.app", "run methods on tasks, once or as a sweep (-m); a Hydra program"),
    "status": ("eval.run.status", "show the progress of sweeps"),
    "collect": ("eval.rows.collect", "gather the rows of finished runs into one CSV per experiment"),
    "tables": ("eval.publish.tables", "write tables from rows: CSV, Markdown and LaTeX"),
    "charts": ("eval.publish.charts", "draw distributions and convergence"),
    "figures": ("eval.publish.figures", "draw rest shapes and results side by side"),
    "front": ("eval.publish.front", "draw measures against each other for values of a setting"),
    "report": ("eval.publish.report.page", "write one HTML page with tables, charts and a 3D view"),
    "publish": ("eval.publish.publish", "put rows, tables and figures of an experiment into results/"),
    "remeasure": ("eval.run.remeasure", "measure finished runs again from their stored vertices"),
    "check": ("eval.rows.bands", "check rows against committed bands of quality"),
    "verify": ("eval.publish.verify", "print the paper's numbers beside yours on FAUST or TOSCA"),
    "bench": ("eval.timing.bench", "time methods in turns, on a machine without other load"),
    "timings": ("eval.timing.table", "write tables of the times from bench"),
}

HELP = """\
Run deformation methods, and make tables, figures and pages from the results.

{commands}

  sshade-eval run method=paper dataset=defaust dataset.root=DIR subject=0 pose=1
  sshade-eval run -m experiment=quick
  sshade-eval collect quick && sshade-eval tables quick && sshade-eval report quick

`sshade-eval COMMAND --help` lists the arguments, and `sshade-eval --print-completion bash` prints a script
that completes arguments in bash; zsh and tcsh are possible, too. Exit codes: 0; 1 if a run or a check failed;
2 after a mistake in the arguments, which is reported in one sentence.
"""

PROGRAM = Program("sshade-eval", COMMANDS, HELP, EXTRAS)
main, call = PROGRAM.main, PROGRAM.call

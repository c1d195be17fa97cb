"""The command ``sshade-eval``: a program with a sub-command for each step of an evaluation.

See :mod:`sshade.core.console`. The sub-command ``run`` is a Hydra program and reads its arguments itself.
"""

from __future__ import annotations

import os

from eval import EXTRAS
from sshade.core.console import Program

# Runs ask git for the state of the checkout. This variable keeps git from locking and writing its index.
os.environ.setdefault("GIT_OPTIONAL_LOCKS", "0")

#: Sub-command -> its module, and a description in one line.
COMMANDS = {
    "run": ("eval.run.app", "run methods on tasks, once or as a sweep (-m); a Hydra program"),
    "collect": ("eval.rows.collect", "gather the rows of finished runs into one CSV per experiment"),
    "tables": ("eval.publish.tables", "write tables from rows: CSV, Markdown and LaTeX"),
    "figures": ("eval.publish.figures", "draw time against truth, and results side by side"),
    "report": ("eval.publish.report", "write one HTML page with tables, charts and a 3D view"),
    "bench": ("eval.bench.bench", "time methods in turns, on a machine without other load"),
    "check": ("eval.check", "compare every method with golden values, and its time with libigl's"),
}

HELP = """\
Run deformation methods, and make tables, figures and pages from the results.

{commands}

  sshade-eval run method=paper dataset=defaust dataset.root=DIR subject=0 pose=1
  sshade-eval run -m experiment=quick
  sshade-eval collect quick && sshade-eval tables quick && sshade-eval report quick

`sshade-eval COMMAND --help` lists the arguments. Exit codes: 0; 1 if a run or a check failed; 2 after a
mistake in the arguments, which is reported in one sentence.
"""

PROGRAM = Program("sshade-eval", COMMANDS, HELP, EXTRAS)
main, call = PROGRAM.main, PROGRAM.call

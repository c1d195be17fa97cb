"""The command ``sshade-eval``: one program with a sub-command for each step of an evaluation.

See :mod:`sshade.cli.programs`; ``run`` alone is a Hydra program, which reads its arguments itself.
"""

from __future__ import annotations

import os

from sshade.cli.programs import Program

# Runs ask git for the state of the checkout; it would refresh its index then, and leave it locked if killed.
os.environ.setdefault("GIT_OPTIONAL_LOCKS", "0")

#: Sub-command -> the module that does it, and what it does in one line.
COMMANDS = {
    "run": ("eval.configure.app", "run methods on tasks, once or as a sweep (-m); a Hydra program"),
    "status": ("eval.run.status", "how far the sweeps are"),
    "collect": ("eval.rows.collect", "gather the rows of finished runs into one CSV an experiment"),
    "tables": ("eval.publish.tables", "tables from rows: CSV, Markdown and LaTeX"),
    "charts": ("eval.publish.charts", "distributions, convergence"),
    "figures": ("eval.publish.figures", "the comparison picture: rest shapes and results"),
    "curves": ("eval.publish.curves", "metrics against a size or a parameter"),
    "front": ("eval.publish.front", "what a setting costs: measures against each other"),
    "report": ("eval.publish.report.command", "one HTML page with all of it and a 3D view"),
    "publish": ("eval.publish.publish", "an experiment's rows, tables and figures into results/"),
    "site": ("eval.site.command", "the leaderboard: static pages of all tracks and methods"),
    "submit": ("eval.site.submit", "check results that someone hands in, and put them there"),
    "remeasure": ("eval.run.remeasure", "metrics of finished runs, from their stored vertices"),
    "compare": ("eval.rows.compare", "whether two sets of rows say the same"),
    "check": ("eval.rows.bands", "hold rows against committed bands of quality"),
    "bench": ("eval.timing.bench", "times of methods in turns, on a machine that is quiet"),
    "timings": ("eval.timing.table", "tables of the times that bench wrote"),
    "jumps": ("eval.studies.jumps", "jumps of the deformation across the proxy's edges"),
    "topology": ("eval.studies.topology", "what remeshing keeps of a mesh's topology"),
}

HELP = """\
Run deformation methods, and make tables, figures and pages of what they left.

{commands}

  sshade-eval run method=sshade dataset=defaust dataset.root=DIR subject=0 pose=1
  sshade-eval run -m experiment=quick
  sshade-eval collect quick && sshade-eval tables quick && sshade-eval report quick

`sshade-eval COMMAND --help` tells more. Exit codes: 0; 1 where a run failed or a check did not
hold; 2 for a mistake in the arguments, told in one sentence.
"""

PROGRAM = Program("sshade-eval", COMMANDS, HELP)
main, call = PROGRAM.main, PROGRAM.call

"""``sshade-eval report``: the results of experiments on one HTML page that needs no network.

The page shows numbers, distributions, configurations and failures from rows. If the run folders exist, it
also has pictures of every case and a 3D view.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from eval.publish.plotting import add_camera, camera
from eval.publish.summary import MIXED_HELP
from eval.rows.experiment import read_experiments
from eval.rows.files import ROWS_HELP, add_out, write_text
from sshade.cli.console import progress_bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("rows", nargs="*", type=Path, help=f"{ROWS_HELP} (default: every CSV there)")
    add_out(parser, Path("out/report.html"), "page to write")
    runs = "folders of the run folders (default: out/runs/<experiment>)"
    parser.add_argument("--runs", nargs="+", type=Path, default=[], metavar="FOLDER", help=runs)
    cases = "task names to show in pictures and in 3D (default: pictures of all, three in 3D)"
    parser.add_argument("--cases", nargs="+", default=[], metavar="TASK", help=cases)
    parser.add_argument("--mixed", action="store_true", help=MIXED_HELP)
    add_camera(parser)


def command(options: argparse.Namespace) -> int:
    """Run the sub-command; return its exit code."""
    import jinja2  # noqa: F401 - refused before the rows are read
    import matplotlib  # noqa: F401
    import pyvista  # noqa: F401

    from eval.publish.report.page import write_page

    experiments = read_experiments(options.rows, runs=options.runs)
    with progress_bar() as progress:
        text = write_page(
            experiments, cases=options.cases, mixed=options.mixed, **camera(options), progress=progress
        )
    write_text(options.out, text)
    print(f"{options.out}: {len(text) / 1e6:.1f} MB; open it in a browser")  # noqa: T201
    return 0

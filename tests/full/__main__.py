"""Try everything at full strength: ``python -m tests.full [STEP ...] [--again]``.

A step that has been done is not repeated, unless ``--again`` says so, and one
that was interrupted goes on; what each found is kept under results/runs/robustness.
In the end results/robustness.md tells all of it.
"""

from __future__ import annotations

import argparse
import sys

from tests.full.page import PAGE, told, write_page
from tests.full.record import FOLDER, ROOT, Record, fill, load
from tests.full.steps import steps


def main(argv: list[str] | None = None) -> int:
    """Run the steps and write the page; exit code 1 where something failed."""
    known = steps()
    parser = argparse.ArgumentParser(prog="python -m tests.full", description=__doc__)
    parser.add_argument("step", nargs="*", help=f"all if none is given; one of {', '.join(known)}")
    parser.add_argument("--again", action="store_true", help="also what was done before")
    parser.add_argument("--page", action="store_true", help="only write the page of what was done")
    options = parser.parse_args(argv)
    unknown = [name for name in options.step if name not in known]
    if unknown:
        parser.error(f"there is no step {unknown[0]}; there are {', '.join(known)}")
    for name in [] if options.page else options.step or known:
        step, record = known[name], load(name, FOLDER)
        if options.again or (record.figures.get("failures") and not step.keeps):
            record = Record(name)
        if not record.complete:
            fill(record, step.parts(record.figures), FOLDER)
        outcome = told(step, record) if record.passed else "FAILED"
        print(f"{name}: {outcome} ({record.date}, {record.seconds:.0f} s)", flush=True)  # noqa: T201
        for failure in record.figures.get("failures", []):
            print(f"  {failure}", flush=True)  # noqa: T201
    problems = write_page({name: (step, load(name, FOLDER)) for name, step in known.items()})
    for problem in problems:
        print(problem, file=sys.stderr)  # noqa: T201
    print(f"{PAGE.relative_to(ROOT)} tells it all")  # noqa: T201
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())

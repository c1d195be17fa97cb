"""Try every case: ``python -m tests.robustness [WORD ...]`` prints a table; exit code 1 if one fails.

With words only the cases whose name or entry holds one of them.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from tests.robustness.case import Case, attempt, working_in
from tests.robustness.catalogue import CASES, SLOW
from tests.robustness.inputs import write_sound


def failure(case: Case) -> str:
    """What went otherwise than the case says; empty where nothing did."""
    with tempfile.TemporaryDirectory() as folder, working_in(Path(folder)):
        write_sound()
        try:
            attempt(case)
        except Exception as error:  # an error of the program is what the cases look for
            return f"{type(error).__name__}: {error}"
    return ""


def main(words: list[str]) -> int:
    """Print the table."""
    chosen = [c for c in [*CASES, *SLOW] if not words or any(w in c.name or w in c.entry for w in words)]
    passed = 0
    for case in chosen:
        problem = failure(case)
        passed += not problem
        outcome = "FAILED" if problem else "refused" if case.says else "taken"
        print(f"{outcome:8} {case.entry:22} {case.name}")  # noqa: T201
        if problem:
            print(f"         {problem}")  # noqa: T201
    entries = sorted({case.entry for case in chosen})
    print(f"{len(chosen)} cases over {len(entries)} entry points tried, {passed} passed")  # noqa: T201
    return 0 if passed == len(chosen) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

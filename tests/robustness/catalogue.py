"""All cases, each with a name of its own."""

from __future__ import annotations

from tests.robustness import datasets, evaluation, handle_files, mesh_files, outputs, surfaces
from tests.robustness.case import Case

CASES: list[Case] = [
    *mesh_files.CASES,
    *handle_files.CASES,
    *surfaces.CASES,
    *outputs.CASES,
    *datasets.CASES,
    *evaluation.CASES,
]

#: Too long for the test suite; the command tries them too.
SLOW: list[Case] = [*surfaces.SLOW]

_names = [case.name for case in [*CASES, *SLOW]]
assert len(set(_names)) == len(_names), sorted(name for name in _names if _names.count(name) > 1)

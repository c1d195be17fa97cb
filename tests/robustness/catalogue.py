"""All cases, each with a name of its own."""

from __future__ import annotations

from tests.robustness import api, datasets, evaluation, handle_files, mesh_files, outputs, places, surfaces
from tests.robustness.case import Case

_PARTS = (mesh_files, handle_files, surfaces, outputs, places, datasets, evaluation, api)

CASES: list[Case] = [case for part in _PARTS for case in part.CASES]

#: Too long for the test suite; the command tries them too.
SLOW: list[Case] = [*surfaces.SLOW, *evaluation.SLOW]

_names = [case.name for case in [*CASES, *SLOW]]
assert len(set(_names)) == len(_names), sorted(name for name in _names if _names.count(name) > 1)

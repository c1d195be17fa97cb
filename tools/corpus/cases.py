"""All cases of the corpus."""

from __future__ import annotations

from functools import cache

from tools.corpus import bad, copies, formats, formats_gltf, handle_files, surfaces
from tools.corpus.case import Case


@cache
def cases() -> tuple[Case, ...]:
    """Return all cases; names are unique."""
    parts = (formats, formats_gltf, surfaces, copies, bad, handle_files)
    found = tuple(case for part in parts for case in part.CASES)
    assert len({case.name for case in found}) == len(found), "two cases have one name"
    return found

"""Notes about a result: each note is true and appears once."""

from dataclasses import replace

import pytest

from sshade.cli.notes import notes
from sshade.mesh.surface import SurfaceFacts, surface
from sshade.problem.facts import Facts
from tests.shapes import bumpy

BODY = bumpy(2)
#: The surface of a mesh whose bounding box has a diagonal of 1.
WHOLE = surface(BODY.V / BODY.diagonal, BODY.F)
PLAIN = Facts(samples=100, options={"coarser": 4})


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({}, []),
        (
            {"samples": 40, "options": {"coarser": 2}},
            ["40 samples instead of 100: a component has at most one for every 2"],
        ),
        ({"samples": 130}, ["130 samples instead of 100: a component needs one for each"]),
        ({"samples": 99, "components": 3}, []),  # rounding
        ({"samples": 0}, ["no proxy was made: the handles alone determine the result"]),
        ({"copies": 5, "gap": 0.01}, ["5 vertices were duplicated, and joined again over gaps of"]),
        ({"snap": 0.02}, ["were snapped by at most 0.02, 2 % of the diagonal"]),
        ({"dense": True}, ["the handles are dense: --method interpolate"]),
        ({"opening": 0.11}, ["parts of the mesh that touched came apart by 11 % of the diagonal"]),
        ({"opening": 1e-9, "touching": 3}, []),
        ({"near": 3, "tolerance": 1e-3}, ["3 vertices lie near another vertex", "0.001 of the diagonal"]),
    ],
)
def test_facts_in_words(given, words):
    """Facts of the result, of the surface, and of the command."""
    given = dict(given)
    of_surface = {name: given.pop(name) for name in ("near", "tolerance") if name in given}
    of_command = {"asked": 100, "snap": given.pop("snap", 0.0), "dense": given.pop("dense", False)}
    whole = WHOLE._replace(facts=SurfaceFacts(**of_surface))
    found = list(notes(replace(PLAIN, **given), whole, **of_command))
    assert len(found) == bool(words) and all(word in found[0] for word in words)

"""Notes about a result: each note is true and appears once."""

from dataclasses import replace

import numpy as np
import pytest

from sshade import Handles, Mesh
from sshade.cli.main import main
from sshade.cli.notes import notes
from sshade.files.meshes import write_mesh
from sshade.files.task_files import write_handles
from sshade.mesh.surface import SurfaceFacts, surface
from sshade.problem.facts import Facts
from tests.shapes import beside, bumpy, end_handles

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
        ({"samples": 99, "components": 3}, ["3 components were deformed separately"]),  # rounding
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


def test_many_components_share_one_note(here, capfd):
    """The mesh has 501 components with a boundary: an open body and 500 triangles."""
    rng = np.random.default_rng(0)
    corners = (rng.uniform(-5, 5, (500, 1, 3)) + rng.normal(size=(500, 3, 3)) * 0.1).reshape(-1, 3)
    opened = Mesh(BODY.V, BODY.F[1:])
    mesh = beside(opened, Mesh(corners, np.arange(1500).reshape(-1, 3)))
    write_mesh("body.ply", mesh.V, mesh.F)
    own = end_handles(BODY.V, count=8, shift=(0.3, 0, 0.2))
    every = np.arange(BODY.n, mesh.n)
    bent = mesh.V[every] * 1.2
    write_handles("pose.json", Handles(np.append(own.index, every), np.concatenate([own.target, bent])))
    assert main(["deform", "body.ply", "pose.json", "-o", "out.ply"]) == 0
    lines = capfd.readouterr().err.splitlines()
    assert len(set(lines)) == len(lines) < 8
    assert sum("the volume is not kept in 1 of 501" in line for line in lines) == 1
    assert all(line.startswith(("note: ", "out.ply: ")) for line in lines)

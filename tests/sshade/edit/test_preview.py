"""The preview that the editor shows while a large mesh is dragged."""

import numpy as np
import pytest

from sshade.edit import preview as module
from sshade.edit.commands import Commands
from sshade.edit.preview import preview
from sshade.mesh.mesh import Mesh
from tests.shapes import bumpy
from tests.sshade.edit.lent import unpacked
from tests.sshade.edit.sessions import ready

BODY = bumpy(5)


@pytest.fixture
def large(monkeypatch):
    """Make meshes of few vertices count as large."""
    monkeypatch.setattr(module, "VERTICES", 800)


def test_it_is_the_same_surface_with_about_as_many_vertices_as_asked(large):
    few, wanted = preview(BODY), module.VERTICES
    assert wanted / 2 < len(few.vertices) < 2 * wanted and (np.diff(few.vertices) > 0).all()
    surface = Mesh(BODY.V[few.vertices], few.faces)
    assert surface.area == pytest.approx(BODY.area, rel=0.1)
    assert surface.volume == pytest.approx(BODY.volume, rel=0.1)  # outwards as before


def test_a_small_mesh_has_none():
    assert preview(BODY) is None


def test_a_drag_sends_the_vertices_of_the_preview_and_the_release_all(large, here):
    session, number = ready(BODY)
    commands = Commands(session)
    whole, few = unpacked(commands.whole()), preview(session.mesh)
    assert np.array_equal(whole["coarse"], few.vertices)
    assert np.array_equal(whole["coarse_faces"].reshape(-1, 3), few.faces)
    still = {"pivot": [0, 0, 0], "quaternion": [0, 0, 0, 1]}
    motion = {"group": number, **still, "move": [0.1, 0, 0]}
    step = unpacked(commands("drag", motion))["positions"]
    released = unpacked(commands("release", motion))["positions"].reshape(-1, 3)
    assert len(released) == BODY.n
    assert np.array_equal(step.reshape(-1, 3), released[few.vertices])
    assert np.abs(released - whole["positions"].reshape(-1, 3)).max() > 0.09

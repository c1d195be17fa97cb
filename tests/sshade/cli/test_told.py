"""What the command says: missed targets, rounded positions, surfaces that come apart, and odd handles."""

import tracemalloc

from sshade import Handles
from sshade.cli.notes import handle_notes
from sshade.core import threads
from sshade.files.handle_files import HandleFile
from sshade.problem.handle_checks import astray
from tests.shapes import icosphere


def test_handles_that_shrink_together_are_not_astray():
    rest = icosphere(3).V
    target = 0.01 * rest
    target[::50] += [0.03, 0, 0]  # far for the shrunk ones, and near for the size that they had
    assert len(astray(rest, target)) == 0 < len(astray(rest, 100 * target))


def test_notes_on_the_handles_of_a_large_mesh_take_memory_for_a_part_of_it(monkeypatch):
    monkeypatch.setattr(threads, "available_cpus", lambda: 1)
    mesh = icosphere(7)
    assert mesh.face_areas.all()  # the method has computed them before
    handles = Handles([0, 5], mesh.V[[0, 5]] + [[0, 0, 0], [0, 0, 0.1]], group=[0, 1], dynamic=[False, True])
    tracemalloc.start()
    assert handle_notes(HandleFile((), raw=False), handles, mesh) == []
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 200 * mesh.n  # all sides at once take 500 bytes a vertex

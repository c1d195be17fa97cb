"""The command, Python, the editor, a Deformer and the evaluator give one shape for one method."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sshade import DeformationTask, Deformer, Handles, Mesh, deform, read_handles
from sshade.cli.main import main
from sshade.files.meshes import read_arrays, write_mesh
from sshade.files.task_files import write_handles
from tests.methods import configured
from tests.shapes import bumpy, end_handles
from tests.sshade.edit.sessions import edited

#: Options of `sshade.deform` for each method of the evaluator, and whether a Deformer and the editor have it.
CALLS = {
    "fast": ({}, True, True),
    "fine": ({"method": "fine"}, False, True),
    "paper": ({"method": "paper"}, True, True),
    "paper_plain": ({"method": "paper", "accelerate": False}, False, False),
}


@pytest.fixture(scope="module")
def half_turn(tmp_path_factory):
    """A task whose handles all make half a turn, with one end leaning; and the folder of its files."""
    folder = tmp_path_factory.mktemp("half_turn")
    write_mesh(folder / "rest.ply", bumpy(3).V, bumpy(3).F)
    mesh = Mesh(*read_arrays(folder / "rest.ply"))
    lean = Rotation.from_euler("xy", [180, 20], degrees=True).as_matrix()
    ends = end_handles(mesh.V, turn=lean, shift=[0, 0, 0])
    half, held = Rotation.from_euler("x", np.pi).as_matrix().T, ~ends.dynamic
    target = np.where(held[:, None], mesh.V[ends.index] @ half, ends.target)
    write_handles(folder / "pose.json", Handles(ends.index, target, group=ends.group))
    return DeformationTask("half turn", mesh, read_handles(folder / "pose.json", mesh)), folder


@pytest.mark.parametrize("name", CALLS)
def test_every_entry_starts_a_method_alike(name, half_turn):
    task, folder = half_turn
    options, kept, in_editor = CALLS[name]
    expected = deform(task, **options).vertices
    given = "--no-accelerate" if name == "paper_plain" else "--accelerate"
    words = ["--method", options.get("method", "fast"), *([given] if "paper" in name else [])]
    files = [str(folder / file) for file in ("rest.ply", "pose.json")]
    assert main(["deform", *files, "-o", str(folder / f"{name}.ply"), *words]) == 0
    found = {"command": read_arrays(folder / f"{name}.ply")[0]}
    found["evaluator"] = configured(name)(task, seed=0).vertices
    if kept:
        bound = Deformer(task.mesh, task.handles.index, group=task.handles.group, **options)
        found["Deformer"] = bound.step(task.handles.target).vertices
    if in_editor:
        session = edited(files[0], begin=files[1], method=options.get("method", "fast"))
        session.settle()
        found["editor"] = session.shown
    for entry, V in found.items():
        assert np.abs(V - expected).max() <= 1e-6 * task.mesh.diagonal, entry


def test_the_published_iterations_start_at_rest_and_the_others_at_the_rigid_motion(half_turn):
    task, _ = half_turn
    for method, start in (("paper", "rigid"), ("fast", "rigid"), ("fine", "rigid")):
        given = deform(task, method=method, start=start).vertices
        np.testing.assert_array_equal(deform(task, method=method).vertices, given)
    plain = {"method": "paper", "accelerate": False, "max_iterations": 20, "samplings": 1}
    at_rest = deform(task, **plain, start="rest").vertices
    np.testing.assert_array_equal(deform(task, **plain).vertices, at_rest)
    assert np.abs(deform(task, **plain, start="rigid").vertices - at_rest).max() > 0.01 * task.mesh.diagonal

"""Wrong arguments of Python functions are refused in one sentence, and change nothing."""

import copy
import pickle

import numpy as np
import pytest

import sshade
from sshade import DeformationTask, Deformer, Handles, InputError, Mesh, save_binding
from sshade.files.task_files import write_handles
from sshade.problem.options import Stop
from sshade.proxy.sample import sample_proxy
from tests.shapes import bumpy
from tests.sshade.solver.solver import Solver

BODY = bumpy(2)
HELD = np.array([0, 3, 7, 20])
TARGETS = BODY.V[HELD] + [[0.3, 0, 0], [0, 0, 0], [0, 0.3, 0], [0, 0, 0.2]]


def task(**more) -> DeformationTask:
    return DeformationTask("body", BODY, Handles(HELD, TARGETS), **more)


def refused(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array


OUT = [np.zeros((3, 3)), np.zeros((BODY.n, 3), order="F"), refused(np.zeros((BODY.n, 3)))]


@pytest.mark.parametrize("out", OUT, ids=["short", "of columns", "read-only"])
def test_no_kernel_writes_into_an_array_that_does_not_fit(out):
    bound, drag = sshade.bind(BODY, 40), Deformer(BODY, HELD, vertices=40)
    for call in (lambda: bound.carry(bound.proxy.V, out=out), lambda: drag.step(TARGETS, out=out)):
        with pytest.raises(InputError, match="`out` must be a writable, contiguous float64 array"):
            call()


LARGE = np.array([0, 2**64 - 5], np.uint64)
TWO = TARGETS[:2]
WRONG = {
    "large ids": (lambda: sshade.deform(BODY.V, BODY.F, LARGE, TWO), "is no id of a vertex"),
    "flat positions": (lambda: Handles.from_positions(BODY, np.zeros(9), np.zeros(9)), "of shape"),
    "mask as ids": (lambda: sample_proxy(BODY, 40, first=[True, False]), "integers"),
    "no seed": (lambda: sample_proxy(BODY, 40, seed=None), "a seed is 0 or a positive integer"),
    "id twice": (lambda: Solver(BODY, [3, 3]), "given twice"),
    "tolerance": (lambda: Stop(tolerance=np.nan), "tolerance must be"),
    "key": (lambda: write_handles("x.json", task().handles, about={"author": "me"}), "there is no key"),
    "soft group": (
        lambda: write_handles("x.json", Handles(HELD, TARGETS, weight=[1.0, 2.0, 1.0, 1.0])),
        "the soft handles of group 0 differ",
    ),
    "binding": (lambda: save_binding("gone/x.npz", sshade.bind(BODY, 40)), "cannot be written"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_argument_is_refused(name, here):
    call, words = WRONG[name]
    with pytest.raises(InputError, match=words):
        call()
    assert not list(here.iterdir())


def test_what_is_no_mesh_is_a_type_error():
    for call in (
        lambda: sshade.bind((BODY.V, BODY.F)),
        lambda: sshade.move_along((BODY.V, BODY.F), BODY.V, BODY.V),
        lambda: sshade.transfer_pose(BODY.V, BODY.V),
        lambda: Handles.from_positions(BODY.V, TWO, TWO),
    ):
        with pytest.raises(TypeError, match=r"takes a sshade\.Mesh"):
            call()


def test_faces_of_another_mesh_are_refused_beside_a_file(tmp_path):
    sshade.write(tmp_path / "a.ply", BODY.V, BODY.F)
    sshade.write(tmp_path / "b.ply", BODY.V + 1, BODY.F, like=tmp_path / "a.ply")
    np.testing.assert_array_equal(sshade.read(tmp_path / "b.ply").V, BODY.V + 1)
    with pytest.raises(InputError, match="has other faces"):
        sshade.write(tmp_path / "b.ply", BODY.V, BODY.F[:2], like=tmp_path / "a.ply")


def test_meshes_and_handles_stay_read_only_in_views_and_copies():
    base = BODY.V.copy()
    view = refused(base.view())
    mesh = Mesh(view, BODY.F)
    base *= 2
    np.testing.assert_array_equal(mesh.V, BODY.V)
    assert Mesh(BODY.V, BODY.F).V is BODY.V
    for made in (mesh, Handles(HELD, TARGETS)):
        for copied in (pickle.loads(pickle.dumps(made)), copy.deepcopy(made)):
            arrays = [value for value in vars(copied).values() if isinstance(value, np.ndarray)]
            assert arrays and not any(array.flags.writeable for array in arrays)


def test_a_result_of_a_sequence_may_be_changed():
    poses = [BODY.V[HELD] + share * (TARGETS - BODY.V[HELD]) for share in (0.1, 0.15)]
    changed = []
    for result in sshade.deform_sequence(task(), poses, vertices=40):
        changed.append(result.vertices.copy())
        result.vertices[:] = 0
    kept = [result.vertices for result in sshade.deform_sequence(task(), poses, vertices=40)]
    np.testing.assert_array_equal(changed, kept)

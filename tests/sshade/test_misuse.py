"""Wrong arguments of Python functions are refused in one sentence, and change nothing."""

import copy
import pickle

import numpy as np

import sshade
from sshade import DeformationTask, Handles, Mesh
from tests.shapes import bumpy

BODY = bumpy(2)
HELD = np.array([0, 3, 7, 20])
TARGETS = BODY.V[HELD] + [[0.3, 0, 0], [0, 0, 0], [0, 0.3, 0], [0, 0, 0.2]]


def task(**more) -> DeformationTask:
    return DeformationTask("body", BODY, Handles(HELD, TARGETS), **more)


def test_meshes_and_handles_stay_read_only_in_views_and_copies():
    base = BODY.V.copy()
    view = base.view()
    view.setflags(write=False)
    mesh = Mesh(view, BODY.F)
    base *= 2
    np.testing.assert_array_equal(mesh.V, BODY.V)
    assert Mesh(BODY.V, BODY.F).V is BODY.V
    for made in (mesh, Handles(HELD, TARGETS)):
        for copied in (pickle.loads(pickle.dumps(made)), copy.deepcopy(made)):
            arrays = [value for value in vars(copied).values() if isinstance(value, np.ndarray)]
            assert arrays and not any(array.flags.writeable for array in arrays)


class Mapped(np.ndarray):
    """Arrays of another kind, as np.memmap is."""


def test_arrays_that_are_given_stay_the_callers_and_what_is_made_stays_as_it_was():
    V, F = BODY.V.copy().view(Mapped), BODY.F.copy().view(Mapped)
    index, target, R = HELD.copy(), TARGETS.copy(), np.tile(np.eye(3), (4, 1, 1))
    made = [Mesh(V, F), Handles(index, target), Handles(HELD, TARGETS).at(target, R)]
    kept = pickle.dumps(made)
    for array in (V, F, index, target, R):
        array[:] = 0
    assert pickle.dumps(made) == kept


def test_a_result_of_a_sequence_may_be_changed():
    poses = [BODY.V[HELD] + share * (TARGETS - BODY.V[HELD]) for share in (0.1, 0.15)]
    changed = []
    for result in sshade.deform_sequence(task(), poses, vertices=40):
        changed.append(result.vertices.copy())
        result.vertices[:] = 0
    kept = [result.vertices for result in sshade.deform_sequence(task(), poses, vertices=40)]
    np.testing.assert_array_equal(changed, kept)

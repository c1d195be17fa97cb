"""Goals for the volume of a mesh."""

import numpy as np
import pytest

import sshade
from sshade import DeformationTask, Deformer, InputError, Mesh
from tests.shapes import beside, bumpy, end_handles, shifted, tube

BODY = bumpy(3)
#: Largest relative error of a volume.
WHOLE = 1e-3


def task_of(mesh: Mesh, *, count: int = 12) -> DeformationTask:
    """Return a task with handles at both ends along z; the upper end is moved."""
    return DeformationTask("t", mesh, end_handles(mesh.V, count=count, shift=[0.3, 0, 0.3]))


def ratio(mesh: Mesh, V: np.ndarray) -> float:
    return Mesh(V, mesh.F).volume / mesh.volume


MESHES = {"closed": BODY, "two": beside(BODY, shifted(BODY, [6.0, 0, 0])), "regions": BODY}


@pytest.mark.parametrize("method", ["fast", "fine", "paper"])
@pytest.mark.parametrize("name", MESHES)
def test_goals_are_reached_with_handles_on_their_targets(name, method):
    mesh, count = MESHES[name], {"regions": 150, "two": 40}.get(name, 12)
    options = {"volume": np.inf} if method == "paper" else {}
    result = sshade.deform(task_of(mesh, count=count), method=method, volume_goal=1.1, **options)
    assert ratio(mesh, result.vertices) == pytest.approx(1.1, rel=WHOLE)
    assert ratio(BODY, result.vertices[: BODY.n]) == pytest.approx(1.1, rel=WHOLE)  # of each component
    assert method == "paper" or result.facts.hard_handle_error < 1e-12
    assert result.facts.volume_goal_error < WHOLE and result.facts.options["volume_goal"] == 1.1


def test_a_goal_limits_the_weight_of_the_area_unless_it_is_given():
    def shape(**options):
        return sshade.deform(task_of(BODY), volume_goal=1.3, **options).vertices

    found, whole = shape(), shape(area=1.0)
    assert np.array_equal(found, shape(area=0.1))
    assert Mesh(found, BODY.F).face_areas.sum() > 1.005 * Mesh(whole, BODY.F).face_areas.sum()


@pytest.mark.parametrize("name", ["closed", "regions"])
def test_a_drag_keeps_a_goal(name):
    mesh = MESHES[name]
    task = task_of(mesh, count=150 if name == "regions" else 12)
    drag = Deformer(mesh, task.handles.index, volume_goal=1.1)
    rest, target = mesh.V[task.handles.index], task.handles.target
    for step in (0.5, 1.0):
        drag.step(rest + step * (target - rest), tolerance=1e-4)
    drag.settle()
    assert ratio(mesh, drag.settle().vertices) == pytest.approx(1.1, rel=WHOLE)


BAD = {
    "an endless goal": (BODY, {"volume_goal": np.inf}, "volume_goal must be a number above 0"),
    "no weight": (BODY, {"volume_goal": 1.1, "volume": 0}, "volume_goal needs a weight"),
    "an open mesh": (tube(16, 40), {"volume_goal": 1.1}, "needs a closed surface, and this one has a bound"),
    "an open component": (
        beside(BODY, shifted(tube(16, 40), [6.0, 0, 0])),
        {"volume_goal": 1.1},
        "the component of 640 vertices around vertex 642 cannot be deformed: volume_goal needs a closed",
    ),
    "a flat mesh": (Mesh(BODY.V * [0, 1, 1], BODY.F), {"volume_goal": 1.1}, "this surface is flat"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_goals_are_refused_in_one_sentence(name):
    mesh, options, words = BAD[name]
    task = task_of(mesh, count=40)
    with pytest.raises(InputError, match=words):
        sshade.deform(task, **options)
    with pytest.raises(InputError):
        Deformer(mesh, task.handles.index, **options)

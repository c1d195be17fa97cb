"""The bar of the pictures twists as docs/limits.md says."""

from docs.pictures import solved, twisted
from eval.metrics import measure
from sshade import deform_sequence


def off(task, method):
    """Return the mean distance of a method's result to the true pose."""
    (result,) = solved(task, method)
    return measure(task, result.shape.V)["truth_distance"]


def test_thickness_makes_the_twist_uniform():
    task = twisted(135)
    assert off(task, "fast thickness=1") < 0.2 * off(task, "fast")


def test_a_sequence_turns_the_bar_farther_than_half_a_turn():
    task, steps = twisted(200), range(20, 201, 20)
    poses = [twisted(degrees).handles.target for degrees in steps]
    *_, last = deform_sequence(task, poses, thickness=1)
    assert measure(task, last.vertices)["truth_distance"] < 1
    assert off(task, "fine thickness=1") > 10

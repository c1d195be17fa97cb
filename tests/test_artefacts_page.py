"""The table of the option `detail` is on its page, and the bar twists as docs/limits.md says."""

from docs import artefacts
from eval.metrics import measure
from sshade import deform_sequence


def test_the_page_shows_the_table_of_the_option_detail():
    assert artefacts.PAGE.read_text(encoding="utf-8").count("<!-- detail -->\n| run |") == 1


def test_thickness_makes_the_twist_uniform():
    task = artefacts.twisted("135°")
    plain, thick = (artefacts.solve(task, method)[1][-1] for method in ("fast", "fast thickness=1"))
    assert float(thick) < 0.2 * float(plain)


def test_a_sequence_turns_the_bar_farther_than_half_a_turn():
    task, steps = artefacts.twisted("200°", degrees=200), range(20, 201, 20)
    poses = [artefacts.twisted("", degrees=degrees).handles.target for degrees in steps]
    *_, last = deform_sequence(task, poses, thickness=1)
    assert measure(task, last.vertices)["truth_distance"] < 1
    assert float(artefacts.solve(task, "fine thickness=1")[1][-1]) > 10

"""docs/artefacts.md shows every table of its script, and its numbers agree with the methods' results."""

import re

import numpy as np
import pytest

from docs import artefacts
from eval.metrics import measure
from sshade import deform_sequence

TEXT = artefacts.PAGE.read_text(encoding="utf-8")
#: Rows of all tables by their titles; a later table replaces a row of the same title.
ROWS = {row[0]: row[1:] for row in re.findall("\\| " + r"(.+?) \| " * 7 + r"(\S+) \|", TEXT)}


def test_the_pages_show_every_table_of_the_script():
    for name in artefacts.EXAMPLES:
        text = artefacts.PAGES.get(name, artefacts.PAGE).read_text(encoding="utf-8")
        assert text.count(f"<!-- {name} -->\n| run |") == 1


@pytest.mark.parametrize("method", ["Elastic", "fast", "fine thickness=1", "truth"])
def test_the_numbers_of_the_bar_are_those_of_the_methods(method):
    _, row = artefacts.solve(artefacts.twisted("135°"), method)
    assert np.allclose(np.array(row[1:], float), np.array(ROWS[row[0]], float), rtol=0.05, atol=0.02), row


def test_a_sequence_turns_the_bar_farther_than_half_a_turn():
    task, steps = artefacts.twisted("200°", degrees=200), np.arange(20, 201, 20)
    poses = [artefacts.twisted("", degrees=degrees).handles.target for degrees in steps]
    *_, last = deform_sequence(task, poses, thickness=1)
    assert measure(task, last.vertices)["truth_distance"] < 1
    assert float(ROWS["fine thickness=1, 200°"][-1]) > 10

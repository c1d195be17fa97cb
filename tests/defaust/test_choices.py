"""Checks of the lists and mappings that a configuration gives to a source."""

import pytest

from defaust.sources.choices import require_choice, require_landmarks, shortened
from sshade import InputError


def test_choices():
    assert require_choice(["b", "a"], known={"a": 1, "b": 2}, option="x") == ("b", "a")
    assert require_choice((3, 1), known=range(4), option="x") == (3, 1)
    assert require_choice([], known=range(4), option="x", empty=True) == ()
    assert require_landmarks({"nose": 3, "toe": 0}, option="x") == {"nose": 3, "toe": 0}
    assert shortened([1, 2]) == "1, 2" and shortened(range(9)) == "0, 1, 2, 3, 4, 5 and 3 more"


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("a", "x is 'a', not a list"),
        ([], "x is empty; it needs at least one entry"),
        ([3], r"x\[0\] is 3, not a text"),
        (["c"], "x: there is no 'c'; choose from a, b"),
        (["b", "a", "b"], "x: 'b' is listed twice"),
    ],
)
def test_wrong_choices(value, message):
    with pytest.raises(InputError, match=message):
        require_choice(value, known=("a", "b"), option="x")


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (3, "x is 3, not an object; give names and vertices, e.g. {nose: 332}"),
        ({}, "x is empty; give names"),
        ({"nose": -1}, "x: the vertex of nose is -1; give a number from 0 up"),
        ({"nose": 1, "toe": 1}, "x: nose shares vertex 1 with another landmark"),
    ],
)
def test_wrong_landmarks(value, message):
    with pytest.raises(InputError, match=message):
        require_landmarks(value, option="x")

"""Values of a configuration against a schema."""

import pytest

from defaust.schema import mismatch


@pytest.mark.parametrize(
    ("value", "schema", "words"),
    [
        ({"a": 1}, {"a": int, "b": str}, ""),
        ({"x": [1], "y": []}, {str: [int]}, ""),
        ({"a": True}, {"a": int}, "a is True, not a whole number"),
        ({"a": float("nan")}, {"a": float}, "a is nan, not a number"),
        ([10**400], [float], "[0] is 1" + 17 * "0" + "..." + 19 * "0" + ", not a number"),
        ({"a": [{"b": 1}, {"b": "x"}]}, {"a": [{"b": int}]}, "a[1].b is 'x', not a whole number"),
        ({"a": "x"}, {"a": (float, None)}, "a is 'x', not a number"),
        ([1.0], [float, float], "it has 1 items, not 2"),
    ],
)
def test_the_first_mismatch_is_named(value, schema, words):
    assert mismatch(value, schema) == words

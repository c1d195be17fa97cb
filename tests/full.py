"""Let `make test` run a few parameters of a test; `make robustness` runs all parameters."""

from collections.abc import Iterable
from typing import Any

import pytest


def few(values: Iterable[Any], *everyday: Any) -> list[Any]:
    """Return all values, with the mark `full` on every value that is not in `everyday`."""
    values = list(values)
    assert set(everyday) < set(values)
    return [value if value in everyday else pytest.param(value, marks=pytest.mark.full) for value in values]

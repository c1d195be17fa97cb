"""Parameters of tests of which a few are enough for `make test`; `make robustness` runs all."""

from collections.abc import Iterable
from typing import Any

import pytest


def few(values: Iterable[Any], *everyday: Any) -> list[Any]:
    """The values, those that are not everyday ones marked as `full`."""
    values = list(values)
    assert set(everyday) < set(values)
    return [value if value in everyday else pytest.param(value, marks=pytest.mark.full) for value in values]

"""One test for a table of calls that are refused."""

from collections.abc import Callable
from typing import Any

import pytest

from sshade import InputError


def refusals(table: dict[str, Callable[[], Any]], error: type[Exception] = InputError) -> Callable[..., None]:
    """Return a test that each call is refused in one sentence, which has the words of its key."""

    @pytest.mark.parametrize("words", table)
    def test(words: str) -> None:
        with pytest.raises(error, match=words) as refused:
            table[words]()
        assert "\n" not in str(refused.value)

    return test

"""Scenes in Python give what is recorded, with as many calls and as much memory."""

import pytest

from tests.record import work
from tests.record.compared import differences


@pytest.mark.parametrize("name", work.transcripts())
def test_results_calls_and_memory_are_those_recorded(name, here):
    assert not (found := differences(work.played(name), work.recorded(name))), "\n".join(found)

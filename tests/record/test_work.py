"""Scenes in Python give what is recorded, with as many calls and as much memory."""

import pytest

from tests.record import work
from tests.record.compared import differences


@pytest.mark.parametrize("name", work.transcripts())
def test_results_calls_and_memory_are_those_recorded(name, here):
    """What a process allocates once, at a time that depends on earlier tests, counts in one play alone."""
    recorded = work.recorded(name)
    found = differences(work.played(name), recorded) and differences(work.played(name), recorded)
    assert not found, "\n".join(found)

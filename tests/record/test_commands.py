"""Commands say and write what is recorded; ``python -m tests.record`` records anew what has changed."""

import pytest

from tests.record.compared import differences
from tests.record.transcript import played, recorded, transcripts


@pytest.mark.parametrize("name", transcripts())
def test_commands_say_and_write_what_is_recorded(name, here):
    lines = recorded(name)
    assert not (found := differences(played(lines), lines)), "\n".join(found)

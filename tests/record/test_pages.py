"""Node plays the scripts of pages: they ask, show and draw what is recorded. No browser is needed."""

import pytest

from tests.record.compared import differences
from tests.record.transcript import PAGES, played, recorded, transcripts


@pytest.mark.parametrize("name", [name for name in transcripts() if name.startswith(PAGES)])
def test_pages_show_and_ask_what_is_recorded(name, here):
    lines = recorded(name)
    assert not (found := differences(played(lines), lines)), "\n".join(found)

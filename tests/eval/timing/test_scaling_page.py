"""docs/scaling.md: its tables are those of its rows."""

import pandas as pd
import pytest

from docs import scaling
from docs.blocks import filled

ROWS = pd.read_csv(scaling.ROWS)


def test_the_tables_are_those_of_the_rows():
    page = scaling.PAGE.read_text()
    assert filled(page, scaling.tables(ROWS)) == page, "run: python -m docs.scaling"
    with pytest.raises(ValueError, match="0 blocks 'absent'"):
        filled(page, {"absent": ""})

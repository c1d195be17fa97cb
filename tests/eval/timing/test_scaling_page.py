"""docs/scaling.md: its tables are those of its rows, and the model finds what the rows were made by."""

from __future__ import annotations

import numpy as np
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


def planted(noise: float) -> pd.DataFrame:
    rng = np.random.default_rng(0)
    rows = pd.DataFrame(
        {
            "vertices": rng.integers(1_000_000, 20_000_000, 40),
            "samples": rng.integers(1_000, 50_000, 40),
            "handles": rng.integers(100, 6_000, 40),
            "threads": 2,
        }
    )
    cost = 0.1 + 0.7 * rows["vertices"] / 1e6 + 0.2 * rows["samples"] / 1e3
    for column in ("seconds", "cpu", "peak_mib"):
        rows[column] = cost * (1 + noise * rng.uniform(-1, 1, 40))
    return rows


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_the_model_finds_the_coefficients(noise):
    for found, error in scaling.models(planted(noise)).values():
        assert found["vertices"] == pytest.approx(0.7, rel=1e-6 + 2 * noise)
        assert found["samples"] == pytest.approx(0.2, rel=1e-6 + 3 * noise)
        assert min(found.values()) >= 0 and error <= 1e-6 + 3 * noise

"""docs/blender.md: its rows are complete, and its script is the script that a test runs."""

import pandas as pd

from docs import blender

ROWS = pd.read_csv(blender.ROWS)


def test_each_size_has_each_method_on_its_poses():
    """A method that failed has the reason in place of measures."""
    assert set(ROWS["method"]) == {*blender.METHODS}
    assert ((ROWS["truth"] >= 0) ^ ROWS["failure"].notna()).all()
    for _, some in ROWS.groupby("vertices"):
        assert some.groupby("method")["pose"].agg(set).map(sorted).map(tuple).nunique() == 1


def test_the_script_on_the_page_is_the_file():
    block = blender.PAGE.read_text().split("```python\n")[1].split("\n```")[0]
    assert block.startswith("def main") and block in (blender.ROOT / "docs" / "blender_task.py").read_text()

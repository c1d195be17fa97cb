"""Tables of times."""

from pathlib import Path

import pytest

from eval.bench.bench import write_tables
from eval.rows.frame import read_csv

RESULTS = Path(__file__).parents[3] / "results"


PUBLISHED = sorted((RESULTS / "timing").glob("*.csv"))


@pytest.mark.parametrize("path", PUBLISHED, ids=lambda path: path.stem)
def test_published_tables_follow_from_published_rows_of_one_clean_commit_and_machine(path, tmp_path):
    """After a change of tables, write_tables makes the published ones again."""
    found = read_csv(path)
    assert not found["env.modified"].any() and found["env.commit"].all()
    assert all(found[column].nunique() == 1 for column in ("env.commit", "env.machine_id"))
    write_tables(found, tmp_path / path.stem)
    for suffix in ("csv", "md"):
        made = (tmp_path / f"{path.stem}.{suffix}").read_bytes()
        assert made == (RESULTS / "tables" / f"{path.stem}.{suffix}").read_bytes()

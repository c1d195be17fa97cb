"""Tables of times: medians, ranges, ratios, and the published ones."""

from pathlib import Path

import pandas as pd
import pytest
from eval_rows import row as row_of_a_run

from eval.bench.bench import notes, time_lines, write_tables
from eval.rows.frame import read_csv, to_frame

RESULTS = Path(__file__).parents[3] / "results"


def row(method, seconds, *, repeat=1, kept=True, **facts):
    return {
        **row_of_a_run(method, "body", key=f"{method}{repeat}", reason="" if kept else "noise"),
        **{"kind": "speed", "repeat": repeat, "round": repeat, "calls": 1, "kept": kept},
        **{"seconds.total": seconds, "seconds.repeat": seconds, "seconds.solve": seconds / 2},
        **{"env.cores_used": 1.5, "other_cores": 0.01, "env.numba_threads": 2},
        **{"task.vertices": 170931, "date": "2026-01-02T00:00:00.000000Z"},
        **facts,
    }


def rows(**facts):
    far = {"extrapolated_to": 1000, "seconds.precompute": 3.0}
    return to_frame(
        [
            *(row("elastic", s, repeat=i, **far, **facts) for i, s in enumerate((200.0, 220.0, 190.0), 1)),
            row("fast", 99.0, kept=False, **facts),
            *(row("fast", s, repeat=i, **facts) for i, s in enumerate((0.5, 0.4, 0.41), 2)),
        ]
    )


def test_median_range_and_ratio_of_the_kept_repeats():
    lines = time_lines(rows())
    elastic, fast = lines.to_dict("records")
    assert (elastic["seconds.total"], elastic["seconds.min"], elastic["seconds.max"]) == (200, 190, 220)
    assert (fast["seconds.total"], fast["seconds.min"], fast["seconds.max"]) == (0.41, 0.4, 0.5)
    assert fast["repeats"] == 3
    assert fast["speed_up"] == pytest.approx(200 / 0.41) and elastic["speed_up"] == 1
    assert elastic["extrapolated"] == "from 3 x 10 iterations" and elastic["iterations"] == 1000
    assert pd.isna(fast["extrapolated"]) and fast["iterations"] == 10
    assert "rejected repeats: 1 (noise)" in " ".join(notes(rows()))


def test_both_factors_of_speed_are_columns():
    """A method against 1,000 iterations of libigl, and against the accelerated Elastic at its minimum."""
    both = pd.concat([rows(), to_frame([row("accelerated_elastic", 16.4)])], ignore_index=True)
    lines = time_lines(both).set_index("method")
    assert lines.at["fast", "speed_up"] == pytest.approx(200 / 0.41)
    assert lines.at["fast", "speed_up_accelerated"] == pytest.approx(16.4 / 0.41)
    assert "speed_up_accelerated" not in time_lines(rows())


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

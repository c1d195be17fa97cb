"""Tables of times: medians, ranges, refusals, and publication."""

from pathlib import Path

import pandas as pd
import pytest
from eval_rows import row as row_of_a_run

from eval.main import call, main
from eval.rows.frame import to_frame, write_csv
from eval.timing.table import make_time_table
from sshade.core.errors import InputError


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
    table = make_time_table(rows(), title="speed")
    elastic, fast = table.lines.to_dict("records")
    assert (elastic["seconds.total"], elastic["seconds.min"], elastic["seconds.max"]) == (200, 190, 220)
    assert (fast["seconds.total"], fast["seconds.min"], fast["seconds.max"]) == (0.41, 0.4, 0.5)
    assert fast["repeats"] == 3
    assert fast["speed_up"] == pytest.approx(200 / 0.41) and elastic["speed_up"] == 1
    assert elastic["extrapolated"] == "from 3 x 10 iterations" and elastic["iterations"] == 1000
    assert pd.isna(fast["extrapolated"]) and fast["iterations"] == 10
    notes = " ".join(table.notes)
    assert "Code c0dec0dec0dec0de (commit abcdef0123), 2026-01-02" in notes
    assert "Machine: box; numba_threads 2" in notes
    assert "rejected repeats: 1 (noise)" in notes


def test_cases_are_compared_each_with_its_own_reference():
    small = rows(**{"task.checksum": "c2", "task.vertices": 5000})
    small["seconds.total"] = small["seconds.total"].where(small["method.name"] == "fast", 41.0)
    lines = make_time_table(pd.concat([rows(), small], ignore_index=True), title="speed").lines
    assert lines["speed_up"].round(3).tolist() == [1, round(200 / 0.41, 3), 1, 100]


def test_cases_with_equal_arrays_are_compared_each_with_its_own_reference():
    both = pd.concat([rows(), rows(**{"task.name": "copy"})], ignore_index=True)
    lines = make_time_table(both, title="s").lines
    assert lines["speed_up"].round(3).tolist() == [1, round(200 / 0.41, 3)] * 2


def test_notes_name_the_first_and_the_last_day_and_calls_that_ran_once():
    found = rows()
    found["date"] = [f"2026-01-{day:02}T00:00:00.000000Z" for day in range(9, 9 + len(found))]
    notes = " ".join(make_time_table(found, title="s").notes)
    assert ", 2026-01-09 to 2026-01-15." in notes and "ran once" not in notes
    assert "A call of more than 60 s ran once" in " ".join(make_time_table(found[:1], title="s").notes)


@pytest.mark.parametrize(
    ("facts", "words"),
    [
        ({"env.version.code": "v2"}, r"2 versions of code \(c0dec0dec0dec0de; v2\)"),
        ({"env.version.numpy": "2.0"}, None),
        ({"env.machine": "N"}, r"2 machines \(N; box\)"),
        ({"method.hash": "other"}, "'elastic' has rows of different parameters"),
    ],
)
def test_mixtures_are_refused(facts, words):
    joined = pd.concat([rows(), rows(**facts)], ignore_index=True)
    if words is None:  # only some of the rows name a version of the library
        make_time_table(joined, title="speed")
    else:
        with pytest.raises(InputError, match=words):
            make_time_table(joined, title="speed")


@pytest.fixture
def folder(here):
    Path("results").mkdir()
    return here


def test_what_comes_from_a_commit_is_published(folder):
    write_csv("out/timing/speed.csv", rows())
    assert call("timings", ["speed", "--publish"]) == 0
    assert Path("results/timing/speed.csv").read_bytes() == Path("out/timing/speed.csv").read_bytes()
    assert {path.name for path in Path("results/tables").iterdir()} == {"speed.csv", "speed.md"}
    Path("out/timing/speed.csv").unlink()
    assert call("timings", ["speed"]) == 0 and Path("out/tables/speed.md").is_file()


@pytest.mark.parametrize("facts", [{"env.modified": True}, {"env.commit": None, "env.modified": None}])
def test_what_no_commit_holds_is_not_published(folder, capsys, facts):
    write_csv("out/timing/speed.csv", rows(**facts))
    assert main(["timings", "speed", "--publish"]) == 2
    assert "come from a checkout with changes that are not committed" in capsys.readouterr().err
    assert not any(Path("results").iterdir())


def test_a_file_without_times_is_refused(folder, capsys):
    assert main(["timings"]) == 2 and "out/timing: no rows of times" in capsys.readouterr().err
    assert main(["timings", "gone"]) == 2 and "out/timing/gone.csv: no rows" in capsys.readouterr().err
    write_csv("out/timing/other.csv", rows().drop(columns=["kept"]))
    assert main(["timings", "other"]) == 2 and "the rows hold no times" in capsys.readouterr().err
    assert not Path("out/tables").exists()


def test_slopes_of_subdivisions():
    sizes = [(100_000, 1.0), (400_000, 2.0), (1_600_000, 4.0), (10_000, 1.0)]
    lines = [
        row("fast", s, kind="scaling", peak_mib=8.0, **{"task.vertices": n, "task.checksum": str(n)})
        for n, s in sizes
    ]
    table = make_time_table(to_frame(lines), title="scaling")
    assert table.notes[-1] == "fast: slope 0.50 of log time against log vertices, from 100,000 vertices on."
    assert table.lines["bytes_per_vertex"].tolist() == [8 * 2**20 / n for n, _ in sizes]

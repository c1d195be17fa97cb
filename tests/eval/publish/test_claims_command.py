"""``sshade-eval claims``: the result of a claim follows from the rows, and `make verify` makes the rows."""

import re
from pathlib import Path

import pytest

from eval.main import main
from eval.publish.claims import SOURCES, examine, read_claims, table
from eval.rows.frame import to_frame, write_csv
from sshade.errors import InputError
from tests.eval.eval_rows import lost, planned, row

ROOT = Path(__file__).parents[3]
CLAIMS = [claim for claims in read_claims().values() for claim in claims]
LESS = {"says": "a is smaller", "measure": "volume", "holds": "one a < one b"}
MORE = {**LESS, "holds": "one a > one b"}


def write(folder, values, name="one_own", tasks=1):
    """Write rows of methods with a mean volume for each subject; one seed of its first task has it all."""
    rows = [
        row(method, f"s{subject}/t{task}", seed=seed, metric__volume=of_seed, task__meta__subject=subject)
        for method, volumes in values.items()
        for subject, volume in enumerate(volumes)
        if volume is not None
        for task, own in enumerate([tasks * volume, 0, 0][:tasks])
        for seed, of_seed in enumerate([4 * own, 0, 0, 0])
    ]
    folder.mkdir(exist_ok=True)
    write_csv(folder / f"{name}.csv", to_frame(rows))


@pytest.mark.parametrize(
    ("a", "b", "less", "more"),
    [
        ([1, 2, 3], [2, 3.1, 4], "confirmed", "refuted"),
        ([2, 3, 4.1], [1, 2, 3], "refuted", "confirmed"),
        ([1, 2, 3], [0, 4, 3], "undecided", "undecided"),
        ([1, 2], [2, 3], "seen", "not seen"),
        ([5], [1], "not seen", "seen"),
        ([None, 2], [1, None], "no rows", "no rows"),
        ([1, 2, 3, 9], [2, 3.1, 4, None], "confirmed", "refuted"),
    ],
)
def test_the_result_follows_from_the_subjects_that_both_sides_have(tmp_path, a, b, less, more):
    write(tmp_path / "rows", {"a": a, "b": b})
    results = [examine(claim, "own", tmp_path / "rows").result for claim in (LESS, MORE)]
    assert results == [less, more]


def test_a_side_may_be_a_number_or_another_experiment(tmp_path):
    write(tmp_path / "rows", {"a": [1, 2, 6]}, tasks=3)
    write(tmp_path / "rows", {"a": [2, 4, 6]}, name="two_own")
    found = examine({**LESS, "holds": "one a < 20"}, "own", tmp_path / "rows")
    assert found == (3, 20, 3, 9, "confirmed")
    found = examine({**LESS, "holds": "two a > one a"}, "own", tmp_path / "rows")
    assert found[:4] == (4, 9, 3, 3)
    assert examine({**LESS, "holds": "one a < gone a"}, "own", tmp_path / "rows").result == "no rows"


def test_failed_runs_and_missing_measures_are_no_rows(tmp_path):
    rows = [row("a", task__meta__subject=0), lost("b") | {"task.meta.subject": 0}, planned("c")]
    write_csv(tmp_path / "one_own.csv", to_frame(rows))
    assert examine(LESS, "own", tmp_path).result == "no rows"
    assert examine({**LESS, "measure": "d_H", "holds": "one a < 9"}, "own", tmp_path).result == "no rows"


def test_rows_of_two_builds_are_refused(tmp_path):
    two = [row("a", task__checksum=name, task__source=name, key=name) for name in ("one", "two")]
    write_csv(tmp_path / "one_own.csv", to_frame(two))
    with pytest.raises(InputError, match=r"has two rows of a on t1, .*; remove out/runs/one_own and "):
        examine(LESS, "own", tmp_path)


def test_published_rows_give_the_results_of_the_page(tmp_path):
    for name in ("table1", "table1_lowres"):
        (tmp_path / f"{name}_faust.csv").symlink_to(ROOT / "results" / "rows" / f"{name}.csv")
    lines = [line.split(" | ") for line in table("faust", tmp_path).splitlines()]
    found = {line[0].strip("| "): (line[2], line[-1].strip("| ")) for line in lines}
    assert found["Elastic loses more volume on finer meshes"][1] == "confirmed"
    assert found["ARAP-SR changes edges more than Elastic"][1] == "confirmed"
    assert found["fast keeps the volume"] == ("", "no rows")


def test_make_verify_runs_each_method_that_a_claim_names():
    settings = dict(re.findall(r"^(\w+) +:= (.+)$", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
    for claim in CLAIMS:
        assert claim["measure"] in SOURCES and re.search(" [<>] ", claim["holds"])
        for experiment, method in re.findall(r"(\w+) ([a-z_]+(?:-\d+)?)", claim["holds"]):
            name, _, number = method.partition("-")
            text = settings[experiment]
            file = (ROOT / "conf" / "experiment" / f"{experiment}.yaml").read_text(encoding="utf-8")
            assert re.search(rf"[=,]{name}\b", text) or f"label: {name}-" in file, claim
            assert not number or re.search(rf"[=,]{number}\b", text), claim


def test_the_command_writes_the_table_or_says_what_is_missing(here, capsys):
    assert main(["claims", "faust"]) == 2
    assert capsys.readouterr().err == "error: out/rows has no rows of faust; `make verify` makes them\n"
    (here / "out").mkdir()
    write(here / "out" / "rows", {"fast": [0.01, 0.02, 0.03]}, name="bodies_170k_faust")
    assert main(["claims", "mars"]) == 2
    assert "conf/claims.yaml has no claims about 'mars'; use faust or tosca" in capsys.readouterr().err
    assert main(["claims", "faust"]) == 0
    text = (here / "out" / "tables" / "claims_faust.md").read_text()
    write(here / "own", {"fast": [0.1, 0.1, 0.1], "fine": [0.2]}, name="bodies_170k_faust")
    assert "| 0.1 = 0.1 |  | 3 | 3 | undecided |" in table("faust", here / "own")
    assert "| 0.2 > 0.1 |  | 1 | 1 | not seen |" in table("faust", here / "own")
    assert "| fast keeps the volume | volume (%) | 0.02 < 0.1 |  | 3 | 3 | confirmed |" in text
    assert text in capsys.readouterr().out

"""Plans of sweeps are stored and joined, and planned runs without a row are missing."""

import json
import shutil

import pytest
from eval_rows import row

from eval.rows.plan import forget_plans, missing_rows, read_plans, write_plan
from sshade.core.errors import InputError


def planned(method="a", pose=1, *, seed=0, root="data", **more):
    source = {"_target_": "load", "root": root, **more, "pose": pose}
    return {"method.name": method, "seed": seed, "task.source": json.dumps(source)}


def planned_of(subject):
    return planned() | {"task.source": json.dumps({"_target_": "load", "subject": subject, "pose": 1})}


def done(task, **of):
    return row(of.get("method", "a"), task, task__source=planned(**of)["task.source"], seed=of.get("seed", 0))


def test_plans_of_several_sweeps_stand_together_and_a_rerun_adds_none(tmp_path):
    one, other, again = ([planned(name) | {"env.version.code": code}] for name, code in ("ac", "bc", "ad"))
    for runs in (one, other, again):
        write_plan(tmp_path, runs)
    assert sorted(read_plans(tmp_path), key=str) == sorted([*again, *other], key=str)
    shutil.copytree(tmp_path, tmp_path / "copy", copy_function=shutil.copyfile)
    assert read_plans(tmp_path / "copy") == [*other, *again]
    forget_plans(tmp_path)
    assert read_plans(tmp_path) == []


@pytest.mark.parametrize("text", ["", "[]", '{"version": []}', '{"runs": [{"seed": 0}]}', '{"runs": [1]}'])
def test_a_damaged_plan_is_told(tmp_path, text):
    write_plan(tmp_path, [planned()])
    (path,) = tmp_path.rglob("*.json")
    path.write_text(text)
    with pytest.raises(InputError, match=rf"{path.name}: not a plan \(.*\); remove it"):
        read_plans(tmp_path)


def test_what_no_row_answers_for_is_missing():
    runs = [planned(m, pose, seed=s) for m in "ab" for pose in (1, 2) for s in (0, 1)]
    rows = [done("t1"), done("t1", seed=1), done("t2", pose=2, root="copy/of/data", method="b")]
    told = {(r["method.name"], r["task.name"], r["seed"]) for r in missing_rows([*runs, *runs], rows)}
    assert told == {("a", "t2", 0), ("a", "t2", 1), ("b", "t1", 0), ("b", "t1", 1), ("b", "t2", 1)}
    (one,) = missing_rows([planned(pose=3)], rows)
    assert missing_rows([planned_of(7)], rows)[0]["task.meta.subject"] == 7
    assert one["task.name"] == "_target_=load pose=3"  # the name of the case is not known yet
    assert (one["status"], one["reason"]) == ("missing", "planned, never run")
    assert one["task.source"] == planned(pose=3)["task.source"]
    assert missing_rows([one], [done("t3", pose=3)]) == []
    assert missing_rows([one | {"task.name": "t3"}], rows)[0]["task.name"] == "t3"


@pytest.mark.parametrize(
    ("known", "name"),
    [
        ("set/subject_00/pose_1", "set/subject_07/pose_12"),
        ("set/subject_00/pose_1/points", "set/subject_07/pose_12/points"),
        ("mine_1", "_target_=load subject=7 pose=12"),
    ],
)
def test_planned_cases_have_the_names_of_other_cases_of_their_dataset(known, name):
    one, other = planned(subject=0), planned(subject=7, pose=12)
    rows = [row("a", known, task__source=one["task.source"])]
    assert [run["task.name"] for run in missing_rows([one, other], rows)] == [name]

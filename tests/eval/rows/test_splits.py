"""The halves of the benchmark."""

import pytest

from eval.rows import splits
from eval.rows.splits import BOTH, HELD_OUT, TUNING, require_split, split_of
from sshade.core.errors import InputError

OLD, NEW = range(1, 5), range(5, 11)


def test_new_poses_of_the_last_five_bodies_are_held_out_and_a_case_of_a_readers_own_is_in_no_half():
    body = "defaust-synthetic/subject_{:02d}/pose_{}".format
    assert {split_of(body(s, p)) for s in range(10) for p in OLD} == {TUNING}
    assert {split_of(body(s, p)) for s in range(5) for p in NEW} == {TUNING}
    assert {split_of(body(s, p)) for s in range(5, 10) for p in NEW} == {HELD_OUT}
    assert split_of("mine/pose") is None


def test_a_case_in_both_halves_is_refused(monkeypatch):
    monkeypatch.setattr(splits, "read_splits", lambda: {TUNING: ["a/*"], HELD_OUT: ["*/b"]})
    with pytest.raises(InputError, match="both halves"):
        split_of("a/b")


@pytest.mark.parametrize("split", [TUNING, HELD_OUT])
def test_a_case_of_the_other_half_is_refused(split):
    cases = {TUNING: "defaust-synthetic/subject_07/pose_4", HELD_OUT: "defaust-synthetic/subject_07/pose_5"}
    other = cases.pop({TUNING: HELD_OUT, HELD_OUT: TUNING}[split])
    with pytest.raises(InputError, match=rf"{other} is a .* but the experiment states run.split={split}"):
        require_split(other, split)
    for stated in (split, BOTH, None):
        require_split(cases[split], stated)
    require_split("mine/pose", split)

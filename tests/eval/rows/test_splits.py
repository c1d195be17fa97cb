"""The halves of the benchmark."""

import pytest

from eval.rows import splits
from eval.rows.splits import BOTH, HELD_OUT, TUNING, require_split, split_of
from sshade import InputError

KINDS = ("", "/points", "/regions")


def test_new_bodies_are_held_out_and_other_pairs_of_tuned_bodies_and_poses_are_in_no_half():
    body = "defaust-synthetic/subject_{:02d}/pose_{}".format
    assert {split_of(body(s, p)) for s in range(10) for p in range(1, 5)} == {TUNING}
    assert {split_of(body(s, p)) for s in range(5) for p in range(5, 11)} == {TUNING}
    assert {split_of(body(s, p)) for s in range(5, 10) for p in range(5, 11)} == {None}
    new = "defaust-new_bodies/subject_{}/pose_{}".format
    held = {split_of(new(s, f"{p}{kind}")) for s in range(10, 15) for p in range(1, 7) for kind in KINDS}
    assert held == {HELD_OUT}
    assert split_of("mine/pose") is None


def test_a_case_in_both_halves_is_refused(monkeypatch):
    monkeypatch.setattr(splits, "read_splits", lambda: {TUNING: ["a/*"], HELD_OUT: ["*/b"]})
    with pytest.raises(InputError, match="both halves"):
        split_of("a/b")


def test_a_case_of_neither_half_is_refused_unless_both_are_stated():
    """Cases of the other half are refused by the command: test_eval_cli.py."""
    neither = "defaust-synthetic/subject_07/pose_5"
    for split in (TUNING, HELD_OUT):
        with pytest.raises(InputError, match=f"{neither} is in neither half .*, but the experiment states"):
            require_split(neither, split)
        require_split("mine/pose", split)
    for accepted in (BOTH, None):
        require_split(neither, accepted)

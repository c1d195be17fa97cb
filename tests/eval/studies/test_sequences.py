"""The tables of ``sshade-eval sequences``."""

import pytest

from defaust.tasks import motions
from eval.main import call
from sshade import InputError


def test_the_command_prints_both_tables(monkeypatch, capsys):
    (drive,) = motions.drives(((0, 4),))
    few = drive._replace(pose_names=drive.pose_names[:1], poses=drive.poses[:1], truth=drive.truth[:1])
    monkeypatch.setattr(motions, "drives", lambda: [few])
    assert call("sequences", ["--quick", "--motions", "arms_up", "--poses", "8"]) == 0
    out = capsys.readouterr().out
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in out.splitlines()]
    sequence, single = (next(row for row in rows if kind in row) for kind in ("sequence", "single runs"))
    assert sequence[:5] == ["arms_up", "6,890", "fast", "sequence", "7 of 8"]
    assert single[4] == "0 of 8" and float(sequence[-1]) < 2.0
    drive_row = next(row for row in rows if row[:1] == ["body 0 to 4"])
    error, copied, still = (float(drive_row[place]) for place in (5, 7, 9))
    assert error < copied < still and error < 0.1 * still


def test_too_few_poses_are_refused():
    with pytest.raises(InputError, match="a number from 3"):
        call("sequences", ["--poses", "2"])

"""Old names of methods and options are refused with their new names; committed rows have no old names."""

import csv
import re
from pathlib import Path

import pytest

from eval.configure.compose import read_choice, resolved
from eval.rows.frame import read_csv, write_csv
from eval.rows.old_names import METHODS
from sshade.errors import InputError
from sshade.options import OLD_NAMES

ROOT = Path(__file__).parents[3]
METHOD_FILES = sorted((ROOT / "conf/method").rglob("*.yaml"))


@pytest.mark.parametrize("folder", ["rows", "timing"])
def test_committed_rows_have_new_names_and_are_written_again_as_they_are(folder, tmp_path):
    for path in sorted((ROOT / "results" / folder).glob("*.csv")):
        write_csv(tmp_path / "again.csv", read_csv(path))
        assert (tmp_path / "again.csv").read_bytes() == path.read_bytes()
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        assert not any("sshade_" in row["method.name"] for row in rows)
        assert not OLD_NAMES.keys() & {name.rpartition(".")[2] for name in rows[0] if "method." in name}


@pytest.mark.parametrize("old", METHODS)
def test_an_old_method_is_refused_with_its_new_name(old):
    with pytest.raises(InputError, match=f"the method {old} is now named {METHODS[old]};"):
        resolved("method", read_choice(old))
    with pytest.raises(InputError, match="the option method.parts is now named method.attachment;"):
        resolved("method", read_choice("fast parts=0.1"))
    assert METHODS[old] in {path.stem for path in METHOD_FILES}
    assert old not in {path.stem for path in METHOD_FILES}


def test_the_change_log_lists_every_old_name_with_its_new_name():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    renamed = text.partition("### Renamed\n")[2].partition("\n\nNames of the first days")[0]
    listed = {}
    for old, new in re.findall(r"^\|[^|]*\|([^|]+)\|([^|]+)\|$", renamed, re.M):
        names = [[name.rpartition("/")[2] for name in re.findall(r"`([^`]+)`", cell)] for cell in (old, new)]
        for name, renamed_to in zip(*names, strict=True):
            listed.setdefault(name, set()).add(renamed_to)
    every = [*METHODS.items(), *OLD_NAMES.items()]
    assert [(old, new) for old, new in every if new not in listed.get(old, ())] == []
    assert len(every) > 6

"""Old names of methods, options and facts: the renaming is one to one."""

import csv
import re
from pathlib import Path

import pytest

from eval.configure.compose import read_choice, resolved
from eval.rows.csv_rows import COUNT
from eval.rows.frame import read_csv, write_csv
from eval.rows.old_names import FACTS, LEFT_OUT, METHODS, new_column, new_label, with_new_names
from sshade.errors import InputError
from sshade.options import OLD_NAMES

RESULTS = Path(__file__).parents[3] / "results"
METHOD_FILES = sorted((RESULTS.parent / "conf/method").rglob("*.yaml"))
FILES = sorted([*RESULTS.glob("rows/*.csv"), *RESULTS.glob("timing/*.csv")])


def written(path):
    """The cells of a file as text."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_no_two_names_of_a_file_meet():
    """Files of rows have old names or today's; two files may hold the same method under both."""
    labels, columns, values = set(), set(), {column: set() for column in FACTS}
    for path in FILES:
        rows = written(path)
        here = {row["method.name"] for row in rows}
        assert len({new_label(label) for label in here}) == len(here)
        assert len({new_column(column) for column in rows[0]}) == len(rows[0])
        labels, columns = labels | here, columns | set(rows[0])
        for column, (_, new) in FACTS.items():
            found = {row[column] for row in rows if row.get(column)}
            assert len({new.get(value, value) for value in found}) == len(found)
            values[column] |= found
    assert len(labels) > 60 and len(columns) > 150 and all(values.values())
    assert not any("sshade_" in new_label(label) or new_label(label) == "sshade" for label in labels)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(RESULTS).as_posix())
def test_committed_rows_written_again_differ_in_the_renamed_cells_alone(path, tmp_path):
    write_csv(tmp_path / "again.csv", read_csv(path))
    values = {column: values for column, (_, values) in FACTS.items()}
    cells = written(path)
    expected = [
        {new_column(name): values.get(name, {}).get(cell, cell) for name, cell in row.items()}
        | {"method.name": new_label(row["method.name"]), COUNT: str(len(cells))}
        for row in cells
    ]
    assert written(tmp_path / "again.csv") == expected


def test_labels_with_settings_are_renamed_by_their_method():
    labels = {
        "sshade": "paper",
        "sshade-triangle-5": "paper-triangle-5",
        "sshade_fine-0.1": "fine-0.1",
        "sshade_fast-6000": "fast-6000",
        "sshade deform --method sshade_paper": "sshade deform --method paper_plain",
        "sshadow": "sshadow",
        "without_parts": "without_attachment",
    }
    assert {label: new_label(label) for label in labels} == labels
    old = {"method.coarse.parts": 0.1, "method.limit": None, "extra.proxy_basin": "lead", "metric.limit": 1}
    new = {"method.coarse.attachment": 0.1, "method.strain_limit": None}
    assert with_new_names(old) == new | {"extra.proxy_initialisation": "guide", "metric.limit": 1}


@pytest.mark.parametrize("old", METHODS)
def test_an_old_method_is_refused_with_its_new_name(old):
    with pytest.raises(InputError, match=f"the method {old} is now named {METHODS[old]};"):
        resolved("method", read_choice(old))
    with pytest.raises(InputError, match="the option method.parts is now named method.attachment;"):
        resolved("method", read_choice("fast parts=0.1"))
    assert METHODS[old] in {path.stem for path in METHOD_FILES}
    assert old not in {path.stem for path in METHOD_FILES}


def test_the_change_log_lists_every_old_name_with_its_new_name():
    text = (RESULTS.parent / "CHANGELOG.md").read_text(encoding="utf-8")
    renamed = text.partition("### Renamed\n")[2].partition("\n\nNames of the first days")[0]
    listed = {}
    for old, new in re.findall(r"^\|[^|]*\|([^|]+)\|([^|]+)\|$", renamed, re.M):
        names = [[name.rpartition("/")[2] for name in re.findall(r"`([^`]+)`", cell)] for cell in (old, new)]
        for name, renamed_to in zip(*names, strict=True):
            listed.setdefault(name, set()).add(renamed_to)
    columns = {old: new for old, (new, _) in FACTS.items() if old != new}
    values = FACTS["extra.proxy_basin"][1]
    every = [*METHODS.items(), *OLD_NAMES.items(), *LEFT_OUT.items(), *columns.items(), *values.items()]
    assert [(old, new) for old, new in every if new not in listed.get(old, ())] == []
    assert len(every) > 15

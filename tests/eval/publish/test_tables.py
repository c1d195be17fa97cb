"""Tables: a small table by hand, marks, notes, and rows that must not be mixed."""

import pytest
from eval_rows import lost, missing, row, table_of

from eval.metrics import METRICS
from eval.publish.columns import COLUMNS, REACHED, TRANSFER_COLUMNS
from eval.publish.tables import to_latex, to_markdown
from sshade.core.errors import InputError


@pytest.fixture
def rows():
    novolume = {"metric__volume": None, "converged": None}
    return [
        row("arap", metric__volume=4.0),
        row("arap", "t2", metric__volume=8.0, iterations=20.0, status="not_converged", converged=False),
        row("paper_plain", metric__angle=1.0, **novolume),
        row("paper_plain", "t2", metric__angle=2.0, metric__handle=0.2, **novolume),
        lost("worse"),
    ]


def test_markdown(rows):
    lines = to_markdown(table_of(*rows)).splitlines()
    assert lines[:15] == [
        "### t",
        "",
        "| method | runs | volume (%) | area (%) | EL (%) | FA (deg) | handle (%) | iterations |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
        "| arap | 2 | 6.00 | 2.00 | 3.00 | 4.000 | 0.000 | 15 (1/2) |",
        "| worse | 0/2 | failed | failed | failed | failed | failed | failed |",
        "| paper_plain | 2 | n/a | 2.00 | 3.00 | 1.500 | 0.100 | 10 |",
        "",
        "#### t: further measures",
        "",
        "| method | runs | success (%) |",
        "| --- | ---: | ---: |",
        "| arap | 2 | 100.0 |",
        "| worse | 0/2 | 0.0 |",
        "| paper_plain | 2 | 50.0 |",
    ]
    notes = "\n".join(lines[15:])
    assert "2 cases of 1,000 vertices, 2 subjects; means over all of them." in notes
    assert "Machine: box." in notes
    assert "- worse: 1 failed (ValueError: no): t1.\n- worse: 1 missing (never run): t2." in notes


def test_latex_compiles_with_any_label_and_with_notes_of_several_lines():
    text = to_latex(table_of(row(r"a_b^2~\c", method__note="one & two\nthree\n")))
    assert r"% a_b^2~\c: one & two three" in text.splitlines()
    assert r"a\_b\^{}2\~{}\textbackslash{}c & 1 & 1.00" in text


def test_every_measure_has_a_place_in_a_table():
    shown = {column.source.removeprefix("metric.") for column in (*COLUMNS, *TRANSFER_COLUMNS)}
    # angle_relative is the formula in the paper's text; the paper's table deviates from it.
    assert METRICS.keys() - shown == {"angle_relative", "zero_area_faces"}


def test_success_is_the_share_of_all_runs_that_reach_their_handles():
    cases = [("t1", REACHED), ("t2", 1.01 * REACHED), ("t3", None)]
    rows = [row("a", task, metric__handle=gap) for task, gap in cases] + [lost("a", "t4"), missing("a", "t5")]
    assert table_of(*rows).means["success"].tolist() == [20.0]


def test_rows_of_two_datasets_are_refused_and_a_dataset_can_say_what_it_is():
    of = {name: row("a", f"{name}/pose", task__meta__dataset=name) for name in ("faust", "synthetic")}
    with pytest.raises(InputError, match="2 datasets .faust, synthetic.*run.experiment="):
        table_of(*of.values())
    noted = row("a", task__meta__dataset="faust", task__meta__note="The poses are a guess")
    table = table_of(noted, row("b", task__meta__dataset="faust"))
    assert "The poses are a guess." in table.notes


def transfer_row(method, task="t1", **changes):
    metrics = {"hausdorff": 0.01, "chamfer": 1.5e-7, "truth_distance": 0.02, "truth_edge": 0.3}
    facts = {f"metric__{name}": value for name, value in metrics.items()}
    facts |= {"metric__truth_angle": 1.0, "metric__handle": None, "iterations": 0.0, "converged": None}
    facts |= {"task__kind": "transfer", "task__meta__class": "a", "task__meta__edit": "none"}
    facts |= {"task__meta__source_pose": "sit", "task__meta__posed_by": "skinning"}
    return row(method, task, **facts | changes)


def test_pose_transfers_by_class_and_edit():
    two = [
        transfer_row("x", f"{kind} {edit}", task__meta__class=kind, task__meta__edit=edit, **pose)
        for kind, pose in (("cat", {"task__meta__source_pose": "cat1"}), ("dog", {}))
        for edit in ("fin", "horns")
    ]
    parts = [part.title for part in table_of(*two, missing("z", "cat fin")).parts]
    # A pose that only some classes have gets no part of the table.
    assert parts == ["class: cat", "class: dog", "edit: fin", "edit: horns"]
    assert table_of(*two[:1]).parts == []


def test_pose_transfers_without_a_truth_show_what_changed():
    unknown = {name: None for name in transfer_row("x") if name.startswith(("metric.hausd", "metric.ch"))}
    table = table_of(transfer_row("x") | unknown)
    assert [c.heading for c in table.columns] == ["volume", "area", "EL", "FA"]
    text = to_markdown(table)
    assert "| x | 1 | 1.00 | 2.00 | 3.00 | 4.000 |" in text
    assert "without ground truth its part is unknown" in text and "Lower is better" not in text


def test_rows_of_two_configurations_are_no_one_method():
    rows = row("a", method__stiffness=1.0), row("a", "t2", method__hash="other", method__stiffness=2.0)
    with pytest.raises(InputError, match=r"'a' has rows of different parameters \(stiffness 1.0 and 2.0\)"):
        table_of(*rows)


def test_a_note_names_cases_whose_rows_are_of_several_builds():
    rows = row("a"), row("b"), row("a", "t2"), row("b", "t2", task__checksum="rebuilt")
    (note,) = [note for note in table_of(*rows).notes if "several tasks" in note]
    assert note.endswith(" may not be comparable: t2.")


def test_a_note_tells_several_versions_of_a_library():
    rows = row("a", env__version__scipy="1.9"), row("b", env__version__scipy="1.10"), row("c")
    assert "Versions of scipy: 1.10, 1.9." in table_of(*rows).notes
    assert not any("Versions of" in note for note in table_of(*rows[1:]).notes)


def test_two_rows_of_one_case_are_refused():
    with pytest.raises(InputError, match="several rows for t1, seed 0"):
        table_of(row("a"), row("a", "t2"), row("a"))
    table_of(row("a"), row("a", seed=1))


def test_crossings_and_the_true_volume_are_columns_of_the_first_table():
    """Both show what methods lose that keep the volume of the rest shape."""
    new = {"metric__self_intersections": 0.0, "metric__truth_volume": 1.5}
    lines = to_markdown(table_of(row("a", **new), row("b", metric__self_intersections=3.0))).splitlines()
    columns = (
        "volume (%) | true volume (%) | area (%) | EL (%) | FA (deg) | handle (%) | crossings | iterations"
    )
    assert lines[2] == f"| method | runs | {columns} |"
    assert lines[4].startswith("| a | 1 | 1.00 | 1.50 |") and "| 0.0 |" in lines[4]
    assert lines[5].startswith("| b | 1 | 1.00 | n/a |") and "| 3.0 |" in lines[5]

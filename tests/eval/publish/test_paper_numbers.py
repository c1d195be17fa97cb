"""``tables --paper``: means of rows beside the paper's numbers; `make verify` makes the rows."""

from eval.main import main
from eval.publish.paper import beside, rows_beside
from eval.rows.frame import to_frame, write_csv
from tests.eval.eval_rows import lost, row


def write(folder, name, *rows):
    folder.mkdir(parents=True, exist_ok=True)
    write_csv(folder / f"{name}.csv", to_frame(rows))


def test_means_are_over_the_valid_rows_of_a_method(tmp_path):
    rows = [row("a", f"t{k}", metric__volume=v, seconds__total=60.0) for k, v in enumerate((1, 2, 6))]
    others = [row("b", metric__hausdorff=0.01), lost("a", "t3")]
    write(tmp_path, "one", *rows, *others)
    paper = {"a": {"volume": 12.4, "time": 435}, "b": {"d_H": 5.66e-3, "d_C": 3.76e-8}, "c": {"volume": 1.29}}
    assert beside(paper, rows_beside(tmp_path / "one.csv")) == [
        ["method", "cases", "volume (%)", "time (s)", "d_H", "d_C"],
        ["a", "3", "12.40 / 3.00", "435.0 / 60.0", "-", "-"],
        ["b", "1", "- / 1.00", "- / 5.0", "5.66e-03 / 1.00e-02", "3.76e-08 / -"],
        ["c", "0", "1.29 / -", "-", "-", "-"],
    ]


def test_the_command_prints_the_tables_or_says_what_is_missing(here, capsys):
    assert main(["tables", "--paper", "faust"]) == 2
    assert capsys.readouterr().err == "error: out/rows has no rows of faust; `make verify` makes them\n"
    write(here / "out" / "rows", "table1_faust", row("elastic", metric__volume=16.75))
    assert main(["tables", "--paper", "faust"]) == 0
    out = capsys.readouterr().out
    assert "| elastic | 1 | 12.25 / 16.75 | 0.45 / " in out

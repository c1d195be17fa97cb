"""The cost of a knob: a curve over its values, points of other methods, and means over common cases."""

import pytest
from eval_rows import frame, lost, row
from matplotlib.text import Annotation, Text

from eval.main import call
from eval.publish.front import draw, front, knob_values, unbeaten, with_times
from eval.rows.frame import write_csv
from sshade.core.errors import InputError


def weighted(name, case="a", *, volume=1.0, weight=None, **changes):
    facts = {"metric__volume": volume, "metric__edge": 2 * volume, "metric__angle": 3 * volume}
    return row(name, case, task__checksum=case, method__volume=weight, **facts | changes)


def test_weights_make_a_curve_and_other_methods_points():
    rows = frame(
        weighted("fine-inf", volume=0.0, weight=float("inf")),
        weighted("fine-0.0", volume=4.0, weight=0.0),
        weighted("fine-0.1", volume=2.0, weight=0.1),
        weighted("fine-1e-05", volume=3.5, weight=1e-05),
        weighted("fine", volume=3.0, weight=0.05),  # a weight, but no number in the name
        weighted("arap", volume=9.0),
        weighted("accelerated-2", volume=7.0),  # a number in the name, but no weight
        weighted("identity", volume=5.0),
    )
    points = front(rows)
    assert points["fine"] == [(v, 2 * v, 3 * v) for v in (4.0, 3.5, 3.0, 2.0, 0.0)]
    values = knob_values(rows, knob="volume", measures=("volume", "edge"), leave_out=())
    assert values["fine"] == ["0.0", "1e-05", "", "0.1", "inf"]
    assert points["arap"] == [(9.0, 18.0, 27.0)] and points["accelerated-2"] == [(7.0, 14.0, 21.0)]
    assert "identity" not in points


def test_means_are_over_the_cases_that_all_have():
    rows = [weighted("fine-1", "a", volume=1.0, weight=1), weighted("fine-1", "b", volume=3.0, weight=1)]
    rows += [weighted("arap", case, volume=volume) for case, volume in (("a", 5.0), ("b", 7.0), ("c", 100.0))]
    points = front(frame(*rows, lost("arap", "d")))
    assert points == {"fine": [(2.0, 4.0, 6.0)], "arap": [(6.0, 12.0, 18.0)]}
    with pytest.raises(InputError, match="no common case with"):
        front(frame(*rows, weighted("other", "z")))
    with pytest.raises(InputError, match="no common case with"):
        front(frame(lost("a")))


def test_another_setting_and_other_measures():
    def limited(limit, **measured):
        means = {f"metric__{name}": value for name, value in measured.items()}
        return row(f"fine-{limit}", method__limit=limit, method__volume=0.0, **means)

    rows = frame(limited(0.1, edge=3.0, bend_tail=20.0), limited(0.3, edge=2.0, bend_tail=30.0))
    points = front(rows, knob="limit", measures=("edge", "bend_tail"))
    assert points == {"fine": [(3.0, 20.0), (2.0, 30.0)]}
    assert set(front(rows, measures=("edge", "bend_tail"))) == {"fine-0.1", "fine-0.3"}


def test_command_draws_rows_of_several_files(tmp_path, capsys):
    knob = [weighted("fine-0.0", weight=0.0), weighted("fine-inf", weight=float("inf"), volume=0.5)]
    write_csv(tmp_path / "front.csv", frame(*knob))
    write_csv(tmp_path / "others.csv", frame(weighted("arap", volume=2.0)))
    paths = [str(tmp_path / f"{name}.csv") for name in ("front", "others")]
    picture = tmp_path / "f.svg"
    assert call("front", [*paths, "-o", str(picture)]) == 0
    text = picture.read_text()
    assert text.count("<!-- fine -->") == text.count("<!-- arap -->") == 1
    # Both ends of the curve are in two panels.
    assert text.count("<!-- 0.0 -->") == text.count("<!-- inf -->") == 2
    assert str(picture) in capsys.readouterr().out
    assert call("front", [*paths, "-o", str(picture), "--leave-out", "arap"]) == 0
    assert "<!-- arap -->" not in picture.read_text() and not capsys.readouterr().err
    with pytest.raises(InputError, match="at least two metrics, and edge is the only one"):
        call("front", [*paths, "--measures", "edge", "edge"])
    write_csv(tmp_path / "others.csv", frame(knob[1] | {"env.version.code": "0lder"}))
    assert call("front", [*paths, "-o", str(picture)]) == 0
    assert capsys.readouterr().err.startswith(
        "Warning: rows of 2 versions of the code, whose numbers may not be"
    )


def test_times_are_those_of_the_same_configuration_and_version():
    rows = frame(weighted("fine"), weighted("slow", method__hash="s"), weighted("new", method__hash="n"))
    timed = [
        row(name, "x", method__hash=key, seconds__total=seconds, kept=kept)
        for name, key, seconds, kept in (
            *(("renamed", rows["method.hash"][0], seconds, True) for seconds in (1.0, 2.0, 9.0)),
            ("slow", "s", 30.0, True),
            ("slow", "s", 99.0, False),
        )
    ]
    found, machine = with_times(rows, frame(*timed))
    assert dict(zip(found["method.name"], found["metric.time"], strict=True)) == {"fine": 2.0, "slow": 30.0}
    assert machine == rows["env.machine"][0]
    with pytest.raises(InputError, match="differ in env.machine"):
        with_times(rows, frame(*timed, timed[0] | {"env.machine": "another"}))
    with pytest.raises(InputError, match="no method was timed"):
        with_times(rows, frame(*(one | {"env.commit": "other"} for one in timed)))
    with pytest.raises(InputError, match="no method was timed"):
        with_times(rows, frame(*(one | {"env.commit": "", "env.version.code": "other"} for one in timed)))
    elsewhere = frame(*(one | {"env.version.code": "of all timed methods"} for one in timed))
    assert with_times(rows, elsewhere)[0]["metric.time"].tolist() == found["metric.time"].tolist()


def test_the_front_has_the_points_that_no_other_beats_and_its_line_is_drawn():
    every = [(3.0, 1.0), (1.0, 5.0), (2.0, 5.0), (2.0, 2.0), (4.0, 1.0), (2.5, 3.0)]
    assert unbeaten(every) == [(1.0, 5.0), (2.0, 2.0), (3.0, 1.0)]
    points = {"quick": [(0.1, 3.0)], "good": [(2.0, 1.0)], "beaten": [(3.0, 2.0)]}
    (axes,) = draw({None: points}, ("time", "edge")).axes
    stairs = [line.get_xydata().tolist() for line in axes.lines if line.get_drawstyle() == "steps-post"]
    assert stairs == [[[0.1, 3.0], [2.0, 1.0]]]


def test_names_of_points_overlap_no_point_and_no_name():
    close = {f"method_{k}": [(1.0 + 0.02 * k, 1.0)] for k in range(6)}
    (axes,) = draw({None: close}, ("volume", "edge")).axes
    names = [text for text in axes.texts if isinstance(text, Annotation)]
    boxes = [Text.get_window_extent(text) for text in names]
    assert [text.get_text() for text in names] == list(close)
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])
    spots = axes.transData.transform([own[0] for own in close.values()])
    assert not any(box.contains(*spot) for box in boxes for spot in spots)
    many = {f"a_method_with_a_long_name_{k}": [(1.0, 1.0)] for k in range(20)}
    (axes,) = draw({None: many}, ("volume", "edge")).axes
    named = [text.get_text() for text in axes.texts]
    assert sorted([*named, *(text.get_text() for text in axes.get_legend().texts)]) == sorted(many)

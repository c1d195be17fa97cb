"""Golden values: what differs or is slow fails, and new values need a higher version."""

from math import inf

import pytest
import yaml

import eval.check
from eval.check import GOLDEN, Found, GoldenFile
from eval.main import call, main
from eval.run.attempt import attempt

HEAD = """\
tolerance: 1.0e-4
floor: {"%": 0.01, deg: 0.01, "-": 1.0e-6}
counts: {tolerance: 0.1, least: 2}
loose:
  - {methods: [bbw], tolerance: 0.5, measures: [edge]}
slower: 2.5
datasets: {}
cases:
  bend: {task: hairpin around=12, methods: [arap, elastic], small: true, timed: true}
small: {"*": max_iterations=3}

values:
"""


class Clock:
    """Seconds that the evaluator is told for each run of a method, and for an iteration of Elastic."""

    def __init__(self) -> None:
        self.method, self.iteration = 3.0, 2.0

    def __call__(self, config, task, **options):
        done = attempt(config, task, **options)
        if done.vertices is None:
            return done
        told = {"seconds.total": self.method, "seconds.solve": self.iteration * done.facts["iterations"]}
        return done._replace(facts={**done.facts, **told})


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(eval.check, "attempt", clock)
    return clock


@pytest.fixture
def golden(here, clock, monkeypatch):
    """Golden values of `arap` on a small tube, in a file of their own."""
    path = here / "golden.yaml"
    path.write_text(HEAD)
    monkeypatch.setattr(eval.check, "GOLDEN", path)
    assert call("check", ["arap"]) == 1  # has no values yet
    assert call("check", ["--write", "arap"]) == 0
    return path


def change(path, **entry):
    """Replace parts of the entry of `arap`; return the new text of the file."""
    values = yaml.safe_load(path.read_text())["values"]
    values["arap"] |= entry
    path.write_text(HEAD + "".join(f"  {line}\n" for line in yaml.safe_dump(values).splitlines()))
    return path.read_text()


def bend(path, **values):
    return {"bend": yaml.safe_load(path.read_text())["values"]["arap"]["bend"] | values}


@pytest.mark.parametrize("name", ["version", "measures"])
def test_a_changed_value_fails_until_a_version_rises(golden, capsys, name):
    right = bend(golden)["bend"]["edge"]
    text = change(golden, **bend(golden, edge=right * 1.001))
    assert call("check", ["arap"]) == 1
    told = capsys.readouterr().out
    assert "arap  differs in 1 of" in told and "edge of bend" in told
    assert "raise `version` in conf/method/NAME.yaml" in told and told.endswith("check --write arap\n")
    assert main(["check", "--write", "arap"]) == 2
    assert "raise `version` in conf/method/arap.yaml" in capsys.readouterr().err
    assert golden.read_text() == text
    change(golden, **{name: 0})
    assert call("check", ["--write", "arap"]) == 0 and call("check", ["arap"]) == 0
    assert bend(golden)["bend"]["edge"] == right


def test_a_slow_method_fails_and_its_new_time_can_be_written(golden, clock, capsys):
    clock.method = 30.0
    assert call("check", ["arap"]) == 1
    assert "arap  is too slow; takes 15 iterations of elastic, golden 1.5" in capsys.readouterr().out
    assert call("check", ["--write", "arap"]) == 0 and call("check", ["arap"]) == 0


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (ModuleNotFoundError("No module named 'torch'", name="torch"), 0, "arap  left out: ModuleNotFound"),
        (ArithmeticError("no"), 1, "arap  failed: ArithmeticError: no"),
    ],
)
def test_a_method_without_a_result_is_left_out_or_fails_and_keeps_its_values(
    golden, capsys, monkeypatch, error, code, line
):
    def method(task, *, seed, progress=None, **options):
        raise error

    text = golden.read_text()
    monkeypatch.setattr("baselines.arap.arap", method)
    assert call("check", ["arap"]) == code and line in capsys.readouterr().out
    assert call("check", ["--write", "arap"]) == code and golden.read_text() == text


@pytest.mark.parametrize(
    ("method", "measure", "golden", "found", "times"),
    [
        ("a", "edge", 2.0, 2.0004, 2.0),
        ("a", "edge", 0.0, 1e-6, 1.0),
        ("a", "bend", 1.0, None, inf),
        ("a", "flips", 0.0, 1.0, inf),
        ("a", "iterations", 100.0, 120.0, 2.0),
        ("bbw", "edge", 2.0, 2.5, 0.5),
    ],
)
def test_tolerances(tmp_path, method, measure, golden, found, times):
    path = tmp_path / "golden.yaml"
    old, new = ({} if value is None else {measure: value} for value in (golden, found))
    path.write_text(f"{HEAD}  {method}: {{bend: {old}}}\n".replace("'", ""))
    different = GoldenFile(path).differences(Found(method, values={"bend": new}))
    assert [one for one, _ in different] == pytest.approx([times] if times > 1 else [])


def test_every_method_has_committed_values_of_its_version():
    file = GoldenFile(GOLDEN)
    folder = GOLDEN.parent / "method"
    names = {path.relative_to(folder).with_suffix("").as_posix() for path in folder.rglob("*.yaml")}
    assert set(file.values) == names - {"external"}
    for name, entry in file.values.items():
        cases = [case for case in file.cases if case.takes(name)]
        assert set(entry) == {"version", "measures", *(case.name for case in cases)} | {
            "time" for c in cases if c.timed
        }
        assert yaml.safe_load((folder / f"{name}.yaml").read_text()).get("version", 1) == entry["version"]

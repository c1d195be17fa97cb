"""Golden values: what differs, is slow or sleeps fails, and new values need a higher version."""

import re
from math import inf
from unittest.mock import patch

import pytest
import yaml

import eval.check
from defaust.tasks.hairpin import hairpin_task
from eval.check import GOLDEN, Found, GoldenFile
from eval.main import call, main
from eval.pace import Pace
from sshade import DeformationResult

HEAD = """\
tolerance: 1.0e-4
floor: {"%": 0.01, deg: 0.01, "-": 1.0e-6}
counts: {tolerance: 0.1, least: 2}
loose:
  - {methods: [bbw], tolerance: 0.5, measures: [edge]}
slower: 1.6
asleep: 0.1
datasets: {unneeded: source=none}
cases:
  bend: {task: hairpin around=12, methods: [arap, elastic], small: true}
  more: {task: hairpin around=14, methods: [arap, elastic], small: true}
small: {"*": max_iterations=3}
timed:
  clock: {task: hairpin around=12, method: elastic}
  tube: {task: hairpin around=12, method: arap}
  large: {task: hairpin around=12, method: arap, full: true}

values:
"""


class Paces:
    """Times that the evaluator is told."""

    def __init__(self) -> None:
        self.found = Pace(1.5, 0.0)

    def __call__(self, clock, timed, enough, *, progress):
        self.asked = {one.name: enough(one.name, self.found) for one in timed}
        return dict.fromkeys(self.asked, self.found)


@pytest.fixture
def paces(monkeypatch):
    paces = Paces()
    monkeypatch.setattr(eval.check, "paces", paces)
    return paces


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The text of a file of golden values of `arap` on a small tube."""
    path = tmp_path_factory.mktemp("check") / "golden.yaml"
    path.write_text(HEAD)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(eval.check, "paces", Paces())
        patch.setattr(eval.check, "GOLDEN", path)
        assert call("check", ["arap"]) == 1  # has no values yet
        assert call("check", ["--write", "arap"]) == 0
    return path.read_text()


@pytest.fixture
def golden(here, paces, written, monkeypatch):
    path = here / "golden.yaml"
    path.write_text(written)
    monkeypatch.setattr(eval.check, "GOLDEN", path)
    return path


def change(path, **entry):
    """Replace parts of the entry of `arap`; return the new text of the file."""
    document = yaml.safe_load(path.read_text())
    document["values"]["arap"] |= entry
    dumped = [yaml.safe_dump(document[part]).splitlines() for part in ("values", "times")]
    values, times = ("".join(f"  {line}\n" for line in lines) for lines in dumped)
    path.write_text(f"{HEAD}{values}times:\n{times}")
    return path.read_text()


def bend(path, **values):
    return {"bend": yaml.safe_load(path.read_text())["values"]["arap"]["bend"] | values}


def test_the_task_of_a_case_is_loaded_once():
    case = GoldenFile(GOLDEN).cases[0]
    with patch("eval.check.task_of", side_effect=lambda *_, **__: object()):
        assert case.loaded is case.loaded


def test_a_changed_value_fails_until_a_version_rises(golden, capsys):
    right = bend(golden)["bend"]["edge"]
    assert right == float(f"{right:.7g}")
    text = change(golden, **bend(golden, edge=right * 1.001))
    assert call("check", ["arap"]) == 1
    told = capsys.readouterr().out
    assert "arap          differs in 1 of" in told and "edge of bend" in told
    assert "raise `version` in conf/method/NAME.yaml" in told and told.endswith("check --write arap\n")
    assert main(["check", "--write", "arap"]) == 2
    assert "raise `version` in conf/method/arap.yaml" in capsys.readouterr().err
    assert golden.read_text() == text
    change(golden, version=9, **bend(golden))
    assert main(["check", "--write", "arap"]) == 2  # a version that falls
    for name in ("version", "measures"):
        change(golden, **{name: 0}, **bend(golden, edge=right * 1.001))
        assert call("check", ["--write", "arap"]) == 0
        assert bend(golden)["bend"]["edge"] == right
    assert call("check", ["arap"]) == 0


def test_values_that_agree_are_not_written_again(golden):
    text = change(golden, **bend(golden, edge=(1 + 1e-6) * bend(golden)["bend"]["edge"]))
    assert call("check", ["--write", "arap"]) == 0
    assert yaml.safe_load(golden.read_text()) == yaml.safe_load(text)


def test_a_slow_method_fails_and_its_new_time_can_be_written(golden, paces, capsys):
    paces.found = Pace(2.5, 0.0)
    assert call("check", ["arap"]) == 1 and paces.asked == {"tube": False}
    assert "time of tube  is too slow; takes 2.5, golden 1.5" in capsys.readouterr().out
    assert call("check", ["--write", "arap"]) == 0 and paces.asked == {"tube": False}
    assert call("check", ["arap"]) == 0 and paces.asked == {"tube": True}
    text, paces.found = golden.read_text(), Pace(2.7, 0.0)
    assert call("check", ["--only", "times", "--write", "arap"]) == 0
    assert golden.read_text() == text  # the times are almost alike
    assert "agrees" in capsys.readouterr().out
    assert call("check", ["--only", "times", "arap"]) == 0 and "agrees" not in capsys.readouterr().out
    paces.found = Pace(1.5, 0.0)
    assert call("check", ["arap"]) == 0
    assert "time of tube  is faster; takes 1.5, golden 2.5" in capsys.readouterr().out


def test_an_entry_gains_a_new_measure_without_a_look_at_times(golden, paces):
    whole = yaml.safe_load(golden.read_text())
    golden.write_text(re.sub(r"\bedge: [^,}]+, ", "", golden.read_text()))
    assert call("check", ["--only", "values", "--write", "arap"]) == 0 and not hasattr(paces, "asked")
    assert yaml.safe_load(golden.read_text()) == whole


def test_a_sleeping_method_fails_whatever_is_written(golden, paces, capsys):
    paces.found = Pace(1.5, 0.17)
    for arguments in (["arap"], ["--write", "arap"], ["arap"]):
        assert call("check", arguments) == 1
        assert "time of tube  sleeps 0.17 s; takes 1.5, golden 1.5" in capsys.readouterr().out


def test_what_takes_long_is_timed_on_demand(golden, paces):
    assert call("check", ["--full", "arap"]) == 1 and paces.asked == {"tube": True, "large": False}
    assert call("check", ["--full", "--write", "arap"]) == 0 and call("check", ["--full", "arap"]) == 0
    assert main(["check", "--only", "times", "elastic"]) == 2  # no time is of this method
    assert call("check", ["elastic"]) == 1 and paces.asked == {"tube": True, "large": True}


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (ModuleNotFoundError("No module 'torch'", name="torch"), 0, "arap          left out: Module"),
        (ArithmeticError("no"), 1, "arap          failed: ArithmeticError: no"),
    ],
)
def test_a_method_without_a_result_keeps_its_values(golden, capsys, monkeypatch, error, code, line):
    def method(task, *, seed, progress=None, **options):
        if task.mesh.n == hairpin_task(around=12).mesh.n:  # the second case would have a result
            raise error
        return DeformationResult(task.mesh.V, iterations=0, converged=None)

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
    assert set(file.times) == {name for one in file.timed for name in one.names}
    for name, entry in file.values.items():
        cases = [case for case in file.cases if case.takes(name)]
        assert set(entry) == {"version", "measures", *(case.name for case in cases)}
        assert yaml.safe_load((folder / f"{name}.yaml").read_text()).get("version", 1) == entry["version"]

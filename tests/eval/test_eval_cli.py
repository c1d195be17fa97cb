"""The Hydra program as users run it: exit codes, one-line errors, sweeps, reruns."""

import logging

import pytest
from eval_program import run_eval

from eval.rows.collect import collect
from eval.rows.frame import records


def test_a_sweep_goes_on_after_a_failure_and_is_resumed(tmp_path, in_process):
    overrides = ["dataset=bumpy", "dataset.level=2", "method=failing,missing_extra,stretching"]
    first = run_eval(tmp_path, "-m", *overrides)
    assert first.returncode == 1
    failed, skipped, done = first.stdout.splitlines()
    assert failed.startswith("[1/3] failing on bumpy_30: failed (ArithmeticError: this method always fails)")
    assert failed.endswith(" left)")
    assert skipped.startswith("[2/3] missing_extra on bumpy_30: skipped (ImportError: torch is not installed")
    assert done.startswith("[3/3] stretching on bumpy_30: not_converged, ")
    assert "Traceback" not in first.stderr
    again = run_eval(tmp_path, "-m", *overrides)
    assert again.returncode == 1
    assert [line.endswith(", already there") for line in again.stdout.splitlines()] == [False, False, True]
    new = run_eval(tmp_path, "-m", *overrides[:2], "method=stretching", "run.force=true")
    assert new.returncode == 0 and "already there" not in new.stdout


@pytest.mark.full
def test_a_run_without_memory_says_so_and_the_others_go_on(tmp_path, capfd):
    sweep = ["-m", "dataset=bumpy", "dataset.level=2", "run.fresh=true", "hydra.verbose=eval.run.attempt"]
    done = run_eval(tmp_path, *sweep, "method=killed,failing,identity")
    logging.getLogger("eval.run.attempt").setLevel(logging.NOTSET)
    assert done.returncode == 1 and "Traceback" not in done.stderr, done.stderr
    told = capfd.readouterr().err  # of the new processes
    assert told.count("Traceback") == 1 and told.startswith("DEBUG eval.run.attempt: eval_cases.failing\n")
    rows = {row["method.name"]: row for row in records(collect(tmp_path / "out/runs/single"))}
    assert "killed by signal 9" in rows["killed"]["reason"] and "memory" in rows["killed"]["reason"]
    assert rows["identity"]["status"] == "ok" and rows["identity"]["peak_mib"] > 10


def test_a_method_that_writes_into_its_task_spoils_neither_its_measures_nor_a_later_run(tmp_path, in_process):
    done = run_eval(tmp_path, "-m", "dataset=bumpy", "dataset.level=2", "method=writing,stretching")
    assert done.returncode == 0
    rows = {row["method.name"]: row for row in records(collect(tmp_path / "out/runs/single"))}
    assert [rows[name]["metric.volume"] for name in ("writing", "stretching")] == pytest.approx([700, 700])


def test_a_configuration_that_is_no_yaml_is_one_sentence(tmp_path):
    (tmp_path / "method").mkdir()
    (tmp_path / "method/broken.yaml").write_text("version: 1\n bending: 3\n")
    done = run_eval(tmp_path, "--config-dir", ".", "method=broken")
    assert done.returncode == 2 and "broken.yaml" in done.stderr and done.stderr.count("\n") == 1

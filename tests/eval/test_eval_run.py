"""One run, one row: clock, statuses, keys, the store."""

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from itertools import product
from pathlib import Path
from time import sleep
from types import SimpleNamespace

import numpy as np
import pytest
from eval_cases import bumpy_task, run

import eval.run.attempt as attempt_module
import eval.run.run as run_module
from eval.metrics import METRICS, measure
from eval.rows.collect import collect
from eval.rows.frame import read_csv, records, write_csv
from eval.rows.store import read_row, require_vertices, run_folders
from eval.run import config, environment, fresh, targets
from eval.run.attempt import TIME_LIMIT, attempt_task
from eval.run.warmup import warm_up
from sshade import DeformationResult, DeformationTask, Handles, InputError, Mesh, TransferTask
from sshade.core.progress import silent
from tests.shapes import bumpy

pytestmark = pytest.mark.usefixtures("in_process")

ARAP = {"_target_": "baselines.arap.arap", "max_iterations": 5, "warm_up": {"max_iterations": 1}}
STRETCHING = {"_target_": "eval_cases.stretching", "factor": 2.0}


@pytest.fixture
def task():
    return bumpy_task(level=2)


def test_a_row_holds_everything(task, tmp_path):
    source = {"_target_": "eval_cases.bumpy_task", "level": 2}
    noted = ARAP | {"note": "after the\n  paper"}
    outcome = run(task, noted, name="arap", root=tmp_path, seed=4, source=source)
    row = read_row(outcome.folder)
    assert row == outcome.row and not outcome.found and not outcome.failed
    stored = require_vertices(outcome.folder, n=task.mesh.n)
    assert stored.dtype == np.float32 and isinstance(stored, np.memmap)  # it is read when it is used
    assert row["method.note"] == "after the paper"
    assert not any(column.startswith("method.warm_up") for column in row)
    given = {name for name, metric in METRICS.items() if "truth" not in metric.needs}
    assert {name for name in row if name.startswith("metric.")} == {f"metric.{name}" for name in given}
    assert row["seconds.total"] >= row["seconds.solve"] > 0 and row["seconds.cpu"] > 0
    assert row["env.cores_used"] == pytest.approx(row["seconds.cpu"] / row["seconds.total"], abs=1e-3)
    assert row["env.version.libigl"] == environment.version_of("libigl") and row["env.version.blas"]


def test_the_true_pose_of_a_case_gets_one_row_which_measures_it_like_a_result(task, tmp_path):
    run(task, STRETCHING, name="s", root=tmp_path / "unknown")
    assert not run_folders(tmp_path / "unknown" / "true_pose")
    known = replace(task, truth=2 * task.mesh.V)
    for name, settings in {"s": {}, "fresh": {"fresh": True}, "again": {"force": True}}.items():
        run(known, STRETCHING, name=name, root=tmp_path, **settings)
    found = run_folders(tmp_path / "true_pose")
    row = read_row(found[0])
    assert len(found) == 1 and row["method.name"] == "true pose" and row["status"] == "ok"
    expected = {f"metric.{name}": value for name, value in measure(known, known.truth).items()}
    assert {name: value for name, value in row.items() if name.startswith("metric.")} == expected
    assert row["metric.truth_distance"] == 0 and row["metric.volume"] == pytest.approx(700)
    assert row["iterations"] is None and not any(name.startswith("seconds.") for name in row)
    shutil.rmtree(found[0])  # as in runs of an older version; the same command adds the row
    assert run(known, STRETCHING, name="s", root=tmp_path).found
    assert run_folders(tmp_path / "true_pose") == found


def test_what_a_method_tells_reaches_the_row_but_neither_arrays_nor_infinities_nor_its_seed(task, tmp_path):
    row = run(task, STRETCHING, name="s", root=tmp_path).row
    assert row["extra.residual"] is None and "extra.rotations" not in row
    assert row["metric.volume"] == pytest.approx(700)
    method = {"_target_": "eval_cases.with_options", "vertices": None, "warm_up": None}
    row = run(task, method, name="o", root=tmp_path).row
    assert (row["method.vertices"], row["method.volume"], row["method.frames"]) == (1000, np.inf, "blended")
    assert row["seed"] == 0 and not {"extra.options", "method.seed"} & row.keys()
    row = run(task, method | {"volume": 0.5}, name="p", root=tmp_path).row
    assert row["method.volume"] == 0.5  # not what the method tells


def test_the_clock_runs_around_the_method_only(task, tmp_path, monkeypatch):
    def slow_measure(task, vertices):
        sleep(0.2)
        return {}

    monkeypatch.setattr(run_module, "measure", slow_measure)
    monkeypatch.setattr(attempt_module, "warm_up", lambda *args, **kwargs: sleep(0.2))
    assert run(task, STRETCHING, name="s", root=tmp_path).row["seconds.total"] < 0.1


def resulting(V, **facts) -> DeformationResult:
    return DeformationResult(**{"vertices": V, "iterations": 0, "converged": None} | facts)


@pytest.mark.parametrize(
    ("method", "reason"),
    [
        (lambda V: resulting(V[:-1]), "shape"),
        (lambda V: resulting(1e200 * V), "coordinates up to"),
        (lambda V: sys.exit(3), "SystemExit: 3"),
        (lambda V: None, "returned NoneType"),
        (lambda V: resulting(V, iterations="many"), "iterations is 'many'; it takes a number from 0 on"),
        (lambda V: resulting(V, iterations=np.nan), "iterations is nan"),
        (lambda V: resulting(V, seconds={"solve": np.nan}), "seconds['solve'] is nan"),
        (lambda V: resulting(V, seconds={"solve": -1.0}), "seconds['solve'] is -1.0"),
        (lambda V: resulting(V, seconds={"total": 0.0}), "seconds['total'], which the evaluator measures"),
        (lambda V: resulting(V, converged="yes"), "converged is 'yes'; it takes True, False or None"),
        (lambda V: resulting(V, extra={"peak_mib": 1.0}), "extra['peak_mib'], which the evaluator measures"),
        (lambda V: resulting(V, extra={"options": {"name": "fast"}}), "extra['options'] has 'name'"),
        (lambda V: resulting(V, extra={"options": "fast"}), "takes a mapping"),
        (lambda V: Path("/\udc80").read_text(), "No such file or directory: '/\\udc80'"),
    ],
)
def test_a_method_without_a_usable_result_leaves_a_failed_row(task, tmp_path, monkeypatch, method, reason):
    monkeypatch.setattr("eval_cases.stretching", lambda task, *, seed, progress=silent: method(task.mesh.V))
    monkeypatch.setattr(attempt_module, "is_ours", lambda method: False)
    done = run(task, {"_target_": "eval_cases.stretching", "warm_up": None}, name="s", root=tmp_path)
    assert done.row["status"] == "failed" and reason in done.row["reason"]
    assert not any(name.startswith("metric.") for name in done.row) and not done.row.get("env.warmed_up")
    assert not (done.folder / "vertices.npy").exists()
    write_csv(tmp_path / "rows.csv", collect(tmp_path))
    assert records(read_csv(tmp_path / "rows.csv"))[0]["reason"] == done.row["reason"]


@pytest.mark.parametrize("name", ["stretching", "failing"])
def test_the_time_limit_of_a_run_is_not_that_of_the_next(task, monkeypatch, name):
    told, method = [], {"_target_": f"eval_cases.{name}", "warm_up": None}
    monkeypatch.setattr(attempt_module, "_cpu_seconds", lambda: told.append(os.environ[TIME_LIMIT]) or 0.0)
    attempt_task(method, DeformationTask, lambda: task, seed=0, time_limit=9.0, progress=silent)
    assert set(told) == {"9.0"} and TIME_LIMIT not in os.environ


def test_a_thread_of_a_method_that_writes_into_its_result_changes_no_measure(task, tmp_path, monkeypatch):
    kept = task.mesh.V.copy()

    def measured(task, vertices):
        kept[:] = 2 * task.mesh.V
        return measure(task, vertices)

    monkeypatch.setattr("eval_cases.stretching", lambda task, *, seed, progress=silent: resulting(kept))
    monkeypatch.setattr(run_module, "measure", measured)
    row = run(task, {"_target_": "eval_cases.stretching", "warm_up": None}, name="s", root=tmp_path).row
    assert row["metric.volume"] == 0


def test_the_key_follows_configuration_versions_task_and_seed(task, tmp_path, monkeypatch):
    def key(task=task, method=STRETCHING, **options):
        return run(task, method, name="s", root=tmp_path, **options).row["key"]

    other = bumpy_task(level=2, angle=31.0)
    keys = [key(), key(method={**STRETCHING, "factor": 3.0}), key(task=other), key(seed=1)]
    assert len(set(keys)) == 4
    # The keys warm_up and _partial_ do not change the result.
    assert key(method={**STRETCHING, "warm_up": {"factor": 1.0}, "_partial_": True}) == keys[0]
    assert key(method=dict(reversed(STRETCHING.items()))) == keys[0]
    guess, renamed = replace(task, guess=task.mesh.V), replace(task, name="renamed")
    assert key(task=renamed) == keys[0] != key(task=guess)
    assert key(method={**STRETCHING, "version": 1}) == keys[0] != key(method={**STRETCHING, "version": 2})
    assert config._loaded.cache_info().currsize <= 1  # meshes of one case are in memory
    monkeypatch.setattr(run_module, "MEASURES", 2)
    assert key() not in keys


def arrays(thing) -> list[np.ndarray]:
    """Return the arrays of a task, of its meshes, and of its handles."""
    if isinstance(thing, np.ndarray):
        return [thing]
    own = vars(thing).values() if isinstance(thing, (DeformationTask, TransferTask, Mesh, Handles)) else ()
    return [array for value in own for array in arrays(value)]


def test_a_method_gets_arrays_of_its_own_and_what_is_measured_has_the_mesh_of_the_run(task):
    V = task.mesh.V
    for given in (replace(task, guess=V + 1.0), TransferTask("t", task.mesh, bumpy(2), V + 1.0)):
        copied = run_module.given(given)
        assert len(arrays(copied)) >= 5
        assert not any(np.shares_memory(*pair) for pair in product(arrays(given), arrays(copied)))
    known = config.with_truth(task, {"_target_": "test_eval_run.known_task", "level": 2})
    assert known.mesh is task.mesh and known.truth is not None


def test_the_cpu_time_of_a_process_has_that_of_its_children():
    assert fresh._cpu_seconds_of(SimpleNamespace(cpu_times=lambda: (1.0, 2.0, 4.0, 8.0, 16.0))) == 15


def test_what_cannot_change_a_result_is_no_setting_at_any_depth():
    inner = {"_target_": "f", "size": 1}
    noted = inner | {"note": "n", "version": 2, "warm_up": {}, "_partial_": True}
    assert targets.settings({"_target_": "g", "inner": noted}) == {"_target_": "g", "inner": inner}
    assert not targets.is_ours({"_target_": "sshade.deform", "inner": inner})
    assert targets.flat({"sizes": [1, 2]}, "method") == {"method.sizes": "[1, 2]"}


@pytest.mark.parametrize("given", [{"force": 1}, {"of": True}, {"of": 1.0}, {"split": 1}])
def test_a_setting_of_another_type_is_refused(given):
    with pytest.raises(InputError, match="does not fit"):
        targets.check_parameters(config.RunSettings, given, target="run")


def test_a_fresh_process_gives_the_same_result_and_a_peak_of_memory(task, tmp_path):
    here = run(task, ARAP, name="a", root=tmp_path)
    ballast = np.ones(40_000_000)  # 305 MiB that must not count for the child process
    fresh = run(task, ARAP, name="a", root=tmp_path, fresh=True)
    assert not fresh.found
    assert 30 < fresh.row["peak_mib"] < ballast.nbytes / 2**20
    assert fresh.row["metric.volume"] == here.row["metric.volume"]
    assert run(task, ARAP, name="a", root=tmp_path, fresh=True).found
    assert run(task, ARAP, name="a", root=tmp_path).found


def test_a_time_limit_ends_a_run_and_is_not_tried_again(task, tmp_path):
    method = {"_target_": "eval_cases.endless"}
    first = run(task, method, name="e", root=tmp_path, time_limit=0.2)
    assert first.failed and first.row["status"] == "timeout"
    assert first.row["reason"] == "no result within 0.2 s"
    for limit in (0.1, 0.2):
        assert run(task, method, name="e", root=tmp_path, time_limit=limit).found
    assert not run(task, method, name="e", root=tmp_path, time_limit=0.3).found


@pytest.mark.parametrize("name", ["row.json", "vertices.npy"])
def test_a_damaged_file_is_made_again_with_a_note(task, tmp_path, name, capfd):
    first = run(task, STRETCHING, name="s", root=tmp_path)
    path = first.folder / name
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    again = run(task, STRETCHING, name="s", root=tmp_path)
    assert not again.found and again.row["metric.volume"] == first.row["metric.volume"]
    assert name in (told := capfd.readouterr().err) and told.endswith("; it is run again\n")
    assert run(task, STRETCHING, name="s", root=tmp_path).found


def known_task(level: int) -> DeformationTask:
    """Load a task that gives its truth, asked or not."""
    task = bumpy_task(level=level)
    return replace(task, truth=task.mesh.V)


@pytest.mark.parametrize(
    ("method", "source", "words"),
    [
        ({}, {"_target_": "test_eval_run.known_task", "level": 2}, "known_task gives the true pose before"),
        ({"version": 0}, None, "method.version=0 does not fit"),
        ({"factor": np.nan}, None, "method.factor is NaN"),
        ({"name": "fast"}, None, "a method cannot have the parameter 'name'"),
    ],
)
def test_a_configuration_that_no_run_can_follow_is_refused(task, tmp_path, method, source, words):
    with pytest.raises(InputError, match=words):
        run(task, STRETCHING | method, name="s", root=tmp_path, source=source)
    assert not run_folders(tmp_path)


def test_a_tree_is_modified_by_files_that_can_change_numbers(tmp_path, monkeypatch):
    here = tmp_path / "eval/run/environment.py"
    here.parent.mkdir(parents=True)
    here.write_text("committed")
    for command in ("init -q", "add .", "-c user.name=a -c user.email=a@b commit -qm one"):
        subprocess.run(["git", "-C", tmp_path, *command.split()], check=True)
    monkeypatch.setattr(environment, "__file__", str(here))
    monkeypatch.setattr(environment, "PACKAGES", tmp_path)
    monkeypatch.setenv("GIT_TEST_ASSUME_DIFFERENT_OWNER", "1")  # the clone of a colleague
    for place, modified in (("README.md", False), ("sshade/new.py", True)):
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_text("new")
        assert environment._commit.__wrapped__()[1] is modified


def test_a_method_warms_up_once_for_its_settings(monkeypatch):
    done = []
    method = lambda task, *, factor, seed, progress=silent: done.append(factor)  # noqa: E731
    monkeypatch.setattr("eval_cases.stretching", method)
    for factor in (31.0, 31.0, 32.0):
        warm_up(STRETCHING | {"factor": factor}, kind=DeformationTask)
    assert done == [31.0, 32.0]


def test_the_checksum_of_a_task_covers_all_that_a_method_reads():
    assert environment.digest(b"ab", b"c") != environment.digest(b"a", b"bc")
    rest = bumpy(1)
    larger, V = Mesh(3 * rest.V, rest.F), rest.V
    one, same = TransferTask("t", rest, rest, 2 * V), TransferTask("other name", rest, rest, 2 * V, truth=V)
    assert environment.task_checksum(one) == environment.task_checksum(same)
    tasks = [one, TransferTask("t", larger, rest, 2 * V), TransferTask("t", rest, larger, 2 * V)]
    tasks.append(TransferTask("t", rest, rest, 3 * V))
    handles = {"index": [0, 1], "target": V[:2], "group": [0, 1]}
    changes = [{}, {"index": [0, 2]}, {"target": V[1:3]}, {"weight": [1.0, 2.0]}, {"group": [0, 0]}]
    changes += [{"dynamic": [True, False]}, {"rotation": np.tile(np.eye(3), (2, 1, 1))}]
    changes.append({"weight": [2.0, 4.0]})
    tasks += [DeformationTask("t", rest, Handles(**handles | change)) for change in changes]
    turned = Mesh(V, rest.F[:, ::-1])
    tasks += [DeformationTask("t", turned, Handles(**handles)), TransferTask("t", turned, turned, 2 * V)]
    tasks.append(DeformationTask("t", rest, Handles(**handles), refuse_unconstrained=True))
    assert len(set(map(environment.task_checksum, tasks))) == len(tasks) == 15

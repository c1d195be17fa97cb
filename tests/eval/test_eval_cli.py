"""The Hydra program as users run it: exit codes, one-line errors, sweeps, reruns."""

import logging
import shlex

import pytest
from eval_cases import bumpy_task
from eval_program import run_eval

from eval.publish.summary import make_table
from eval.rows.collect import collect
from eval.rows.frame import records
from sshade.files.meshes import write_mesh
from sshade.files.task_files import write_handles
from tests.files import contents


def test_warnings_of_a_method_reach_the_user_of_a_sweep(tmp_path):
    task = bumpy_task()
    write_mesh(tmp_path / "open.ply", task.mesh.V, task.mesh.F[:-1])
    write_handles(tmp_path / "pose.json", task.handles)
    overrides = ["dataset=mesh", "dataset.mesh=open.ply", "dataset.handles=pose.json", "method=fast"]
    overrides += ["method.vertices=80"]
    done = run_eval(tmp_path, *overrides, "-m", "run.force=true")  # a flag between settings
    assert done.returncode == 0, done.stderr
    line = "WARNING sshade.method.bound: the volume is not kept: the surface has a boundary"
    assert done.stderr.count("the volume is not kept") == done.stderr.count(line) == 1


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


def test_a_sweep_over_all_takes_the_cases_that_the_dataset_has(tmp_path, in_process):
    common = ["-m", "dataset=listed", "dataset.root=.", "method=stretching", "subject=all"]
    done = run_eval(tmp_path, *common, "pose=all")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    cases = ["[1/4] stretching on bumpy_1", "[2/4] stretching on bumpy_2", "[3/4] stretching on bumpy_11"]
    assert [line.split(":")[0] for line in lines] == [*cases, "[4/4] stretching"]
    assert lines[3].endswith("skipped, . has no subject 1, pose 2; its poses are 1")


def test_settings_of_a_sweep_are_held_against_the_method_of_each_run(tmp_path):
    """The default method of a sweep, paper, does not take polish_iterations, and has no setting alpha."""
    sweep = ["-m", "dataset=bumpy", "dataset.level=2", "method.vertices=60", "method.polish_iterations=1"]
    done = run_eval(tmp_path, *sweep, "method=fine,fine_free", "method.stiffness=0.5", "method.warm_up=null")
    assert done.returncode == 0, done.stderr
    rows = records(collect(tmp_path / "out/runs/single"))
    assert sorted(row["method.name"] for row in rows) == ["fine", "fine_free"]
    assert all((row["method.polish_iterations"], row["method.stiffness"]) == (1, 0.5) for row in rows)
    assert not any(row["env.warmed_up"] for row in rows)


@pytest.mark.parametrize(
    ("settings", "labels"),
    [
        ("method=arap solver.tolerance=0.1,0.2", ["arap-0.1", "arap-0.2"]),
        ("method=arap +method.note=a,b", ["arap-a", "arap-b"]),
        (
            "method=paper method.vertices=40 method.samplings=1 method@method.proxy_method=arap,elastic",
            ["paper-arap", "paper-elastic"],
        ),
        (
            "method=arap method.max_iterations=1,2 solver.start=rest,rigid",
            [f"arap-max_iterations={n}-start={start}" for n in (1, 2) for start in ("rest", "rigid")],
        ),
        ("method=arap solver.start=rest,rigid label=from_${method.start}", ["from_rest", "from_rigid"]),
    ],
)
def test_a_sweep_over_settings_has_labels_with_the_values_that_differ(tmp_path, settings, labels):
    done = run_eval(tmp_path, "-m", "dataset=bumpy", "dataset.level=2", *settings.split())
    assert done.returncode == 0, done.stderr
    rows = collect(tmp_path / "out/runs/single")
    assert sorted(rows["method.name"]) == labels
    assert make_table(rows, title="t").lines["valid"].tolist() == [1] * len(labels)


def test_a_case_of_the_other_half_is_not_run(tmp_path):
    case = ["dataset=hairpin", "dataset.around=12", "method=identity", "run.split=held_out"]
    for mode in ([], ["-m"]):
        done = run_eval(tmp_path, *mode, *case)
        assert done.returncode == 2 and done.stderr.startswith("error: hairpin/gap_0.02 is a tuning case")
    assert not list(tmp_path.rglob("row.json"))


def test_a_configuration_that_is_no_yaml_is_one_sentence(tmp_path):
    (tmp_path / "method").mkdir()
    (tmp_path / "method/broken.yaml").write_text("version: 1\n bending: 3\n")
    done = run_eval(tmp_path, "--config-dir", ".", "method=broken")
    assert done.returncode == 2 and "broken.yaml" in done.stderr and done.stderr.count("\n") == 1


#: Arguments and words of the sentence. Without a dataset, they are for `bumpy`.
REFUSED = {
    "method=paper proxy.vertices=9": "9 proxy vertices cannot hold",
    "dataset=mesh method=arap": "dataset.handles, dataset.mesh is not set",
    "dataset=listed method=arap pose=all": "pose=all takes several runs; add -m",
    "-m dataset=listed subject=1 pose=2,3": "no run of the sweep has a case; . has no",
    "dataset=listed subject=1 pose=2": ". has no subject 1, pose 2; its poses are 1",
    "solver.tolerence=1": "solver.tolerence; did you mean 'tolerance'?",
    "+run.forc=true": "there is no setting run.forc; did you mean 'force'?",
    "-m method=fast,paper method.vertces=9": "did you mean 'vertices'?",
    "-m method=arap,fast method.vertices=9": "no setting method.vertices; not every method has it",
    "-m method=identity,identty": "there is no method 'identty'; did you mean 'identity'?",
    "-m method=identity,slim": "there is no method 'slim'; did you mean 'peer/slim'?",
    "-m method=identity,arap,identity": "method names identity twice",
    "-m method=arap solver.tolerance=1,2,1": "solver.tolerance names 1 twice",
    "-m method=identity,arap label=mine": "method=identity and method=arap have the same label, 'mine'",
    "-m method=arap solver.tolerance=1,2 label=x": "write label='${hydra:runtime.choices.method}-${solver.to",
    "method=arap method.start=middle": "start must be rest or rigid, not 'middle'",
    "run.speed=1": "no setting run.speed",
    "seed=-1": "seed=-1",
    "run.split=half": "it takes tuning, held_out, both or null",
    "run.experiment=../tiny": "run.experiment=../tiny is no name of a folder",
    "method._target_=magic.magic": "no module 'magic'",
    "dataset._target_=os.getcwd": "os.getcwd has no parameter",
    "method=magic": "there is no method 'magic'; choose one of acc",
    "method=arap +method.colour=red": "has no option 'colour'",
    "method=arap method.max_iterations=many": "max_iterations must be a whole number",
    "label=": "label is empty",
    "method=arap label=fast": "the label 'fast' is taken; name arap otherwise",
    "method=identity 'label=true pose'": "the label 'true pose' is taken",
    "method=arap method.version=2": "method.version is set in the method's file",
    "label=mine/a": "label=mine/a has a '/'",
    "method._target_=baselines.arap.magic": "no function 'magic'",
    "method=arap --multirn": "unrecognized arguments: --multirn; did you mean '--multirun'?",
    "arap": "arap is not understood; write settings as key=value",
    "method._target_=magic": "_target_ 'magic' is no function; write package.module.function",
    "method=external method.command=sh": "command='sh' does not fit; it takes list[str]",
    "dataset._target_=builtins.dict": "dict does not tell its parameters",
    "dataset=moon": "there is no dataset 'moon'",
    "paths.runs=a_file/x": "a_file/x",
}


@pytest.mark.parametrize("arguments", REFUSED)
def test_a_mistake_is_one_sentence_and_exit_code_2(tmp_path, arguments):
    (tmp_path / "a_file").touch()
    done = run_eval(tmp_path, *["dataset=bumpy"] * ("dataset=" not in arguments), *shlex.split(arguments))
    assert done.returncode == 2 and REFUSED[arguments] in done.stderr
    assert done.stderr.startswith("error: ") and len(done.stderr.splitlines()) == 1
    # A row is left only for a value that the method itself refuses.
    rows = [name for name in contents(tmp_path) if name.endswith("row.json")]
    assert len(rows) == ("proxy.vertices" in arguments)

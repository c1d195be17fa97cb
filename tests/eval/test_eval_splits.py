"""Every experiment states its half of the benchmark, and cases of the other half are refused."""

import re

import pytest
from compositions import composed
from eval_program import run_eval
from hydra.core.override_parser.overrides_parser import OverridesParser

from eval import CONFIGURATION
from eval.rows.splits import BOTH, split_of
from eval.rows.store import run_folders

EXPERIMENTS = sorted(path.stem for path in CONFIGURATION.glob("experiment/*.yaml"))

#: Subjects and poses in the default build of each source.
DEFAULT = {
    "synthetic": (range(10), range(1, 11)),
    "new_bodies": (range(10, 15), range(1, 7)),
    "noisy": (range(10), range(1, 6)),
    "shapes": (range(4), [1]),
    "animals": (range(4), range(1, 5)),
}


def cases(config):
    """Return the names of an experiment's cases, from its sweep and its dataset's build command."""
    if config.dataset._target_.endswith("hairpin_task"):
        return [f"hairpin/gap_{gap}" for gap in config.hydra.sweeper.params["dataset.gap"].split(",")]
    source = re.search(r"source=(\w+)", config.dataset.build)[1]
    built = re.search(r"subjects=\[([\d,]+)\]", config.dataset.build)
    subjects, poses = DEFAULT[source]
    subjects = map(int, built[1].split(",")) if built else subjects
    known = {"subject": list(subjects), "pose": list(poses)}
    taken = {name: swept(name, config.hydra.sweeper.params[name], numbers) for name, numbers in known.items()}
    assert all(set(taken[name]) <= set(known[name]) for name in known)
    noise = re.search(r"source.noise=(\d+)", config.dataset.build)
    source += f"_{noise[1]}mm" if noise else ""
    return [f"defaust-{source}/subject_{s:02d}/pose_{p}" for s in taken["subject"] for p in taken["pose"]]


def swept(name, values, known):
    if values == "all":
        return known
    override = OverridesParser.create().parse_override(f"{name}={values}")
    return list(map(int, override.sweep_iterator() if override.is_sweep_override() else [override.value()]))


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_an_experiment_states_the_halves_of_its_cases_and_the_papers_tables_start_at_rest(name):
    config = composed(f"experiment={name}")
    halves = {split_of(case) for case in cases(config)}
    assert config.run.split == BOTH or halves == {config.run.split}
    assert config.solver.start == ("rest" if name == "table1" else "rigid")


def test_a_case_of_the_other_half_is_not_run(tmp_path):
    cases = ["dataset=hairpin", "dataset.around=12", "method=identity"]
    for mode in ([], ["-m"]):
        done = run_eval(tmp_path, *mode, *cases, "run.split=held_out")
        assert done.returncode == 2 and done.stderr.startswith("error: hairpin/gap_0.02 is a tuning case")
        assert done.stderr.count("\n") == 1
    assert not run_folders(tmp_path / "out/runs")
    # A tag moves the rows to a separate table, which may hold any case.
    tagged = run_eval(tmp_path, *cases, "run.split=held_out", "+dataset.tag=_mine")
    assert tagged.returncode == 0 and run_folders(tmp_path / "out/runs/single_mine")

"""Installed commands work in a folder that has names of our packages, and after installation from a wheel."""

import os
import subprocess
import sys
from pathlib import Path
from shutil import copytree, ignore_patterns
from zipfile import ZipFile

import pytest

from eval.rows.collect import collect
from eval.rows.frame import records

ROOT = Path(__file__).parents[2]
PACKAGES = ("sshade", "baselines", "defaust", "eval")
MODULE = """
from baselines.identity import identity


def mine(task, *, seed, progress=None):
    return identity(task, seed=seed)
"""


def run(folder, *command, **variables):
    environment = {**os.environ, **variables}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)


@pytest.fixture
def own_folder(tmp_path):
    """Make a user's project with folders `conf`, `eval` and `tests`, and a method in a module."""
    for name in ("conf/method", "eval", "tests", "results"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("eval", "tests"):
        (tmp_path / name / "mine.py").write_text("raise AssertionError('not ours')\n")
    (tmp_path / "eval" / "__init__.py").write_text("raise AssertionError('not ours')\n")
    (tmp_path / "conf" / "method" / "mine.yaml").write_text("_target_: mymethod.mine\n_partial_: true\n")
    (tmp_path / "mymethod.py").write_text(MODULE)
    return tmp_path


MINE = ["--config-dir", "conf", "method=mine"]


def test_workers_of_a_launcher_find_our_packages_in_a_folder_with_folders_of_the_same_names(own_folder):
    command = [Path(sys.executable).with_name("sshade-eval"), "run", "-m", *MINE, "dataset=hairpin"]
    done = run(own_folder, *command, "run.fresh=true", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2")
    assert done.returncode == 0, done.stderr
    (row,) = records(collect(own_folder / "out/runs/single"))
    assert (row["method.target"], row["status"]) == ("mymethod.mine", "ok") and row["peak_mib"] > 10


@pytest.mark.full
def test_a_wheel_has_what_the_commands_need_and_nothing_else(tmp_path, own_folder):
    source, target = tmp_path / "source", tmp_path / "installed"
    left_out = (".*", "*.egg-info", "__pycache__", "compiled")
    copytree(ROOT, source, ignore=ignore_patterns(*left_out, "data", "out", "build"))
    for name in ("defaust/data", "defaust/build"):
        copytree(ROOT / name, source / name, ignore=ignore_patterns(*left_out))
    copytree(ROOT / "sshade" / "compiled", source / "sshade" / "compiled")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    made = run(tmp_path, *pip, "wheel", "--no-deps", "--no-build-isolation", "-w", tmp_path, source)
    assert made.returncode == 0, made.stderr
    (wheel,) = tmp_path.glob("*.whl")
    with ZipFile(wheel) as archive:
        names = [name for name in archive.namelist() if ".dist-info/" not in name]
    assert {name.split("/")[0] for name in names} == set(PACKAGES)
    assert sum(name.startswith("sshade/compiled/sshade.") for name in names) > 50
    files = [path for name in PACKAGES for path in (source / name).rglob("*") if path.is_file()]
    data = {str(path.relative_to(source)) for path in files if path.suffix != ".py" and "-" not in path.name}
    assert len(data) > 5 and data <= set(names)
    installed = run(tmp_path, *pip, "install", "--no-deps", "--no-index", "--target", target, wheel)
    assert installed.returncode == 0, installed.stderr

    def call(name, *arguments):
        done = run(own_folder, sys.executable, target / "bin" / name, *arguments, PYTHONPATH=str(target))
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "deform" in call("sshade", "--help")
    build = "source=synthetic subjects=[0] target_vertices=null workers=1 out=bodies"
    call("defaust", "build", *build.split())
    assert call("defaust", "verify", "bodies") == "bodies: every file is as listed\n"
    sweep = "experiment=quick dataset.root=bodies subject=0 pose=1"
    call("sshade-eval", "run", "-m", *MINE, *sweep.split())
    assert call("sshade-eval", "collect", "quick") == "out/rows/quick.csv: 1 row\n"

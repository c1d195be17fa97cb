"""Editable installations and wheels work where the user's folders have names of our packages."""

import os
import subprocess
import sys
from configparser import ConfigParser
from pathlib import Path
from shutil import copy, copytree, ignore_patterns
from sysconfig import get_path
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
    for name in ("conf/method", "eval", "tests", "results", "sshade"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("eval", "tests"):
        (tmp_path / name / "mine.py").write_text("raise AssertionError('not ours')\n")
        (tmp_path / name / "__init__.py").write_text("raise AssertionError('not ours')\n")
    (tmp_path / "conf" / "method" / "mine.yaml").write_text("_target_: mymethod.mine\n_partial_: true\n")
    (tmp_path / "mymethod.py").write_text(MODULE)
    return tmp_path


MINE = ["--config-dir", "conf", "method=mine"]


class Editable:
    """A clone called `sshade`, installed as by `pip install -e .`. Its packages are links to our own.

    The installation that this Python has itself is left out.
    """

    def __init__(self, folder: Path) -> None:
        clone = folder / "sshade"
        clone.mkdir()
        for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE", "NOTICE", "sshade_eval.py"):
            copy(ROOT / name, clone)
        for name in (*PACKAGES, "conf"):
            (clone / name).symlink_to(ROOT / name)
        build = "from setuptools.build_meta import build_editable; build_editable('..')"
        made = run(clone, sys.executable, "-c", build)
        assert made.returncode == 0, made.stderr
        (wheel,) = folder.glob("*.whl")
        ZipFile(wheel).extractall(folder / "site")
        path = f"sys.path.append({get_path('purelib')!r}); site.addsitedir({str(folder / 'site')!r})"
        self.start = f"import site, sys; {path}\n"
        self.parent = folder

    def python(self, folder: Path, code: str) -> subprocess.CompletedProcess:
        """Run code in a folder that is also on PYTHONPATH."""
        return run(folder, sys.executable, "-S", "-c", self.start + code, PYTHONPATH=".")

    def script(self, folder: Path, name: str, *arguments: str, safe: str = "") -> subprocess.CompletedProcess:
        """Run a command of the installation in a folder that is also on PYTHONPATH."""
        scripts = ConfigParser()
        scripts.read(next(self.parent.glob("site/*.dist-info/entry_points.txt")))
        module, function = scripts["console_scripts"][name].split(":")
        path = self.parent / name
        main = f"if __name__ == '__main__': sys.exit({function}())"
        path.write_text(f"{self.start}from {module} import {function}\n{main}\n")
        return run(folder, sys.executable, "-S", path, *arguments, PYTHONPATH=".", PYTHONSAFEPATH=safe)


@pytest.fixture(scope="module")
def editable(tmp_path_factory) -> Editable:
    return Editable(tmp_path_factory.mktemp("editable"))


def test_python_finds_an_editable_installation_beside_folders_of_our_names(editable, own_folder):
    for name in ("eval", "tests", "defaust", "baselines"):
        (editable.parent / name).mkdir()
    code = "import sshade, eval.main, defaust.cli, baselines.identity; print(sshade.read, sshade.__file__)"
    done = editable.python(editable.parent, code)
    assert str(editable.parent / "sshade" / "sshade") in done.stdout, done.stderr
    for safe in ("", "1"):
        assert editable.script(own_folder, "sshade-eval", "--help", safe=safe).returncode == 0


@pytest.mark.full
def test_commands_and_workers_find_our_packages_before_packages_of_the_same_names(editable, own_folder):
    sweep = ["run", "-m", *MINE, "dataset=hairpin", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2"]
    done = editable.script(own_folder, "sshade-eval", *sweep, "run.fresh=true")
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
    assert {name.split("/")[0] for name in names} == {*PACKAGES, "sshade_eval.py"}
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

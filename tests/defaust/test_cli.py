"""The command line: a real build, and one sentence for each mistake."""

import subprocess
import sys
from pathlib import Path

import pytest

from defaust.configuration import configure
from tests.robustness.case import assert_refused


@pytest.mark.parametrize("arguments", [["bild"], [], ["verify"], ["--fast"]])
def test_a_mistake_in_the_arguments_is_one_sentence(arguments, here):
    assert_refused("defaust", arguments, "`defaust")


def test_module_runs_and_starts_light():
    code = "import sys, runpy, defaust.cli, defaust.tasks, defaust.build.dataset; print(*sorted(sys.modules))"
    code += "; runpy.run_module('defaust', run_name='__main__')"
    command = [sys.executable, "-c", code, "--help"]
    loaded, told = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\n", 1)
    assert not {"pymeshlab", "trimesh", "hydra", "pandas"} & set(loaded.split())
    assert "verify" in told


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["out=x", "source=faust"], "source.root is not set; add e.g. source.root=MPI-FAUST"),
        (["out=x", "window=[1]"], "window has 1 items, not 2"),
        (["out=x", "source=[animals,shapes]"], "names several sources; choose one"),
        (["out=null"], "out=None is no folder; give a name"),
        (["out=x", "source.poses_used=[jump]"], "there is no 'jump'; choose from arms_up"),
        (["out=x", "+source.speed=1"], "unexpected keyword argument 'speed'"),
        (["out=x", "+target_vertice=9"], "no option target_vertice; did you mean 'target_vertices'?"),
        (["out=x", "target_vertice=9"], "no setting target_vertice; did you mean 'target_vertices'?"),
    ],
)
def test_wrong_overrides_are_refused(overrides, message, refused):
    refused(overrides, message)


def test_a_tilde_is_the_home_of_the_user_where_there_is_one(refused):
    assert configure(["out='~/built'"])[1] == Path.home() / "built"
    refused(["out=x", "source=sequence", "source.root='~nobody_here/x'"], "no such folder")

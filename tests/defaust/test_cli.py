"""The command line starts without the libraries of the benchmark."""

import subprocess
import sys


def test_module_runs_and_starts_light():
    code = "import sys, runpy, defaust.cli, defaust.tasks, defaust.build.dataset; print(*sorted(sys.modules))"
    code += "; runpy.run_module('defaust', run_name='__main__')"
    command = [sys.executable, "-c", code, "--help"]
    loaded, told = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\n", 1)
    assert not {"pymeshlab", "trimesh", "hydra", "pandas"} & set(loaded.split())
    assert "verify" in told

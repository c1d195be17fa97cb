"""Call ``sshade-eval run`` with the methods and datasets of the tests, in this process or in a new one."""

import os
import shlex
import subprocess
import sys
from contextlib import chdir
from pathlib import Path

from tests.robustness.case import run

_HERE = Path(__file__).parent
_ARGUMENTS = ["run", "--config-dir", str(_HERE / "extra_conf")]
#: Command and environment to run the program in a new process.
RUN = [sys.executable, "-m", "eval", *_ARGUMENTS]
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join([str(_HERE), str(_HERE.parents[1])])}


def run_program(folder: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess:
    """Run the program in a new process, as a user does.

    Launchers need a new process, because they start their workers in the same way.
    """
    command, environment = [*RUN, *arguments], ENVIRONMENT | variables
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)


def run_eval(folder: Path, *arguments: str) -> subprocess.CompletedProcess:
    """Run the program in this process, in `folder`. It starts ten times as fast as in a new process."""
    with chdir(folder):
        ended = run(shlex.join(["sshade-eval", *_ARGUMENTS, *arguments]))
    return subprocess.CompletedProcess(arguments, *ended)

"""Cases: folders and files that may not be written or read."""

import subprocess
import sys
from pathlib import Path

from tests.files import contents
from tests.robustness.case import Case, check_refusal, nothing, read_only, run
from tests.robustness.datasets import RUN, SMALL, dataset, shapes
from tests.robustness.evaluation import ROWS, RUNS, runs
from tests.robustness.inputs import Given, both, folder
from tests.robustness.outputs import CARRY, remeshed

DENIED = "Permission denied"
DEFORM = "sshade deform {} pose.json -o {}"


def _refused(call: str, given: Given = nothing) -> Case:
    """Return a case in which a command fails and changes no file while the folder d is read-only.

    The command works once the folder may be written.
    """

    def attempt() -> None:
        before = contents()
        with read_only("d"):
            check_refusal(run(call), DENIED)
        assert contents() == before
        code, _, err = run(call)
        assert code == 0, err

    return Case(f"read-only: {call}", attempt, both(given, folder("d")), leaves=(".",))


def _run_of_a_closed_dataset() -> None:
    with read_only("balls"):
        code, _, err = run(RUN)
    assert code == 0, err


def _unreadable(path: str, call: str, given: Given = nothing) -> Case:
    def attempt() -> None:
        Path(path).chmod(0)
        with read_only("closed"):
            check_refusal(run(call), path, DENIED)
        Path(path).chmod(0o644)

    return Case(f"unreadable: {path}", attempt, both(folder("closed"), given), leaves=("closed", "."))


def _sweep_goes_on() -> None:
    """Earlier rows stay and can be collected while no new row can be written."""
    before = {path: data for path, data in contents().items() if path.endswith("row.json")}
    with read_only(RUNS):
        check_refusal(run(f"{RUN} run.experiment=tiny subject=1"), DENIED)
        assert run("sshade-eval collect tiny -o rows")[0] == 0
    assert {path: data for path, data in contents().items() if path.endswith("row.json")} == before
    assert Path("rows/tiny.csv").read_text().count("\n") == 3


PRINTING = [sys.executable, "-m", "eval", "tables", "tiny", "-o", "tables"]


def _to_a_full_device() -> None:
    """Print to a device that is always full, like a log on a full disk."""
    for line in PRINTING, [sys.executable, "-m", "sshade", "--help"]:
        with open("/dev/full", "w") as full:
            done = subprocess.run(line, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
        assert done.returncode == 2 and done.stderr == "error: No space left on device\n", done


def _to_nobody() -> None:
    """Print to a pipe whose reader closes it at once, as ``| head -0`` does."""
    with subprocess.Popen(PRINTING, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        assert process.stderr.read() == "" and process.wait(60) == 141


CASES = [
    _refused(DEFORM.format("body.ply", "d/out.ply")),
    _refused("sshade remesh body.ply -o d/n.ply --map m.npz"),
    _refused("sshade remesh body.ply -o n.ply --map d/m.npz --vertices 40"),
    _refused(CARRY.replace("out.ply", "d/out.ply"), remeshed),
    _refused(f"{SMALL} out=d/out", shapes("a", "b")),
    _refused(f"{RUN} paths.runs=d", dataset),
    _refused("sshade-eval collect tiny -o d", runs),
    _refused("sshade-eval tables tiny -o d/t", runs),
    Case("read-only: runs with rows", _sweep_goes_on, runs, leaves=(".",)),
    Case(f"read-only input: {RUN}", _run_of_a_closed_dataset, dataset, leaves=(".",)),
    Case("full disk: what is printed", _to_a_full_device, runs, leaves=("tables",)),
    Case("nobody reads what is printed", _to_nobody, runs, leaves=("tables",)),
    _unreadable("body.ply", DEFORM.format("body.ply", "out.ply")),
    _unreadable("pose.json", DEFORM.format("body.ply", "out.ply")),
    _unreadable("map.npz", CARRY, remeshed),
    _unreadable("balls/dataset.json", RUN, dataset),
    _unreadable(ROWS, "sshade-eval tables tiny -o t", runs),
]

"""Cases: folders and files that may not be written or read."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.robustness.case import Case, contents, read_only, run
from tests.robustness.datasets import RUN, SMALL, dataset, shapes
from tests.robustness.evaluation import runs
from tests.robustness.inputs import Given, both, folder
from tests.robustness.outputs import CARRY, remeshed

DENIED = "Permission denied"


def _refused(name: str, call: str, given: Given, *, place: str) -> Case:
    """The command ends with one sentence while a folder is closed, all is as it was; then it works."""

    def attempt() -> None:
        before = contents()
        with read_only(place):
            code, out, err = run(call)
        assert (code, out) == (2, ""), (code, out, err)
        assert err.startswith("error: ") and err.count("\n") == 1 and DENIED in err, err
        assert contents() == before
        code, _, err = run(call)
        assert code == 0, err

    return Case(f"read-only: {name}", attempt, given, leaves=(".",))


def _taken(name: str, call: str, given: Given, *, place: str) -> Case:
    """What is only read may lie in a closed folder."""

    def attempt() -> None:
        with read_only(place):
            code, _, err = run(call)
        assert code == 0, err

    return Case(f"read-only: {name}", attempt, given, leaves=(".",))


def _unreadable(name: str, call: str, path: str, given: Given = lambda: None) -> Case:
    def attempt() -> None:
        Path(path).chmod(0)
        with read_only("closed"):
            code, out, err = run(call)
        Path(path).chmod(0o644)
        assert (code, out) == (2, "") and path in err and DENIED in err and err.count("\n") == 1, (code, err)

    return Case(f"unreadable: {name}", attempt, both(folder("closed"), given), leaves=("closed", "."))


def _moved(name: str) -> Given:
    """A closed folder's content: the sound files."""

    def write() -> None:
        Path(name).mkdir()
        for path in ("body.ply", "pose.json"):
            Path(name, path).write_bytes(Path(path).read_bytes())

    return write


def _sweep_goes_on() -> None:
    """Earlier rows stay and are read where no new one can be written."""
    before = {path: data for path, data in contents().items() if path.endswith("row.json")}
    with read_only("out/runs"):
        code, _, err = run(f"{RUN} run.experiment=tiny subject=1")
        assert code == 2 and DENIED in err and err.count("\n") == 1, (code, err)
        assert run("sshade-eval collect tiny -o rows")[0] == 0
    assert {path: data for path, data in contents().items() if path.endswith("row.json")} == before
    assert Path("rows/tiny.csv").read_text().count("\n") == 3


def _to_a_full_device() -> None:
    """What is printed goes to a device that takes nothing, as a log on a full disk."""
    command = [sys.executable, "-m", "eval", "tables", "tiny", "-o", "tables"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
    assert done.returncode == 2 and done.stderr == "error: No space left on device\n", done


def _to_nobody() -> None:
    """As ``| head -0`` does."""
    command = [sys.executable, "-m", "eval", "tables", "tiny", "-o", "tables"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        assert process.stderr.read() == "" and process.wait(60) == 141


DEFORM = "sshade deform {} pose.json -o {}"
REMESH = "sshade remesh body.ply -o {} --map {} --vertices 40"
CASES = [
    _refused("deform", DEFORM.format("body.ply", "d/out.ply"), folder("d"), place="d"),
    _refused("remesh", "sshade remesh body.ply -o d/n.ply --map m.npz", folder("d"), place="d"),
    _refused(
        "remesh, the map",
        "sshade remesh body.ply -o n.ply --map d/m.npz --vertices 40",
        folder("d"),
        place="d",
    ),
    _refused("carry", CARRY.replace("out.ply", "d/out.ply"), both(folder("d"), remeshed), place="d"),
    _refused("build", f"{SMALL} out=d/out", both(shapes("a", "b"), folder("d")), place="d"),
    _refused("a run", f"{RUN} paths.runs=d", both(dataset, folder("d")), place="d"),
    _refused("collect", "sshade-eval collect tiny -o d", both(runs, folder("d")), place="d"),
    _refused("tables", "sshade-eval tables tiny -o d/t", both(runs, folder("d")), place="d"),
    Case("read-only: runs with rows", _sweep_goes_on, runs, leaves=(".",)),
    _taken("the input's folder", DEFORM.format("d/body.ply", "out.ply"), _moved("d"), place="d"),
    _taken("the dataset of a run", RUN, dataset, place="balls"),
    Case("full disk: what is printed", _to_a_full_device, runs, leaves=("tables",)),
    Case("nobody reads what is printed", _to_nobody, runs, leaves=("tables",)),
    _unreadable("a mesh", DEFORM.format("body.ply", "out.ply"), "body.ply"),
    _unreadable("handles", DEFORM.format("body.ply", "out.ply"), "pose.json"),
    _unreadable("a map", CARRY, "map.npz", remeshed),
    _unreadable("a record", RUN, "balls/dataset.json", dataset),
    _unreadable("rows", "sshade-eval tables tiny -o t", "out/rows/tiny.csv", runs),
]

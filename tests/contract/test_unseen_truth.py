"""A method that looks for the true pose wherever its process can keep it finds nothing."""

import json
import subprocess
import sys

import numpy as np
import pytest

from defaust.build.dataset import build
from defaust.tasks import load_task
from eval.run.environment import digest
from sshade.files.meshes import read_mesh
from tests.defaust.toy import OPTIONS, Balls

#: A method that lists what it was given, and all arrays of positions that it can reach: in objects that the
#: garbage collector knows, in modules and their caches, and in the local variables of its callers.
PEEKING = """
import gc
import json
import sys

import numpy as np

from eval.run.environment import digest
from sshade import DeformationResult


def reachable():
    frame, todo = sys._getframe(), [*gc.get_objects(), *sys.modules.values()]
    while frame is not None:
        todo.extend(frame.f_locals.values())
        frame = frame.f_back
    seen = {}
    while todo:
        thing = todo.pop()
        if id(thing) not in seen:
            seen[id(thing)] = thing
            todo.extend(gc.get_referents(thing))
            if issubclass(type(thing), np.ndarray) and thing.base is not None:
                todo.append(thing.base)
    return seen.values()


def peeking(task, *, seed, progress):
    arrays = [x for x in reachable() if issubclass(type(x), np.ndarray) and x.ndim == 2 and x.shape[1] == 3]
    found = {digest(np.asarray(x, dtype=float).tobytes()) for x in arrays if x.dtype.kind == "f"}
    shown = {"truth": task.truth, "name": task.name, "meta": dict(task.meta), "found": sorted(found)}
    with open(f"shown_{seed}.json", "w") as file:
        json.dump(shown, file)
    return DeformationResult(task.mesh.V, iterations=0, converged=None)
"""
COMMAND = "run -m --config-dir conf method=peeking seed=0,1 dataset.root=balls subject=1 pose=2"


@pytest.fixture
def balls(here):
    """A dataset whose poses are not rigid, and the method; they are in the working folder."""
    build(Balls(stretch=1.5), here / "balls", options=OPTIONS, workers=1)
    (here / "peeking.py").write_text(PEEKING)
    (here / "conf/method").mkdir(parents=True)
    (here / "conf/method/peeking.yaml").write_text(
        "_target_: peeking.peeking\n_partial_: true\nwarm_up: null\n"
    )
    return here / "balls"


@pytest.mark.parametrize(("process", "resolution"), [("run.fresh=false", "high"), ("run.fresh=true", "low")])
def test_no_method_finds_the_truth_in_its_process(balls, process, resolution):
    command = [*COMMAND.split(), process, f"dataset.resolution={resolution}"]
    done = subprocess.run([sys.executable, "-m", "eval", *command], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    task = load_task(balls, subject=1, pose=2, resolution=resolution)
    registered = read_mesh(balls / "subject_01/pose_2_low.ply")
    answers = {digest(np.ascontiguousarray(V).tobytes()) for V in (task.truth, registered.V)}
    for seed in (0, 1):  # the truth of the first run has been in memory before the second
        (row,) = [json.loads(p.read_text()) for p in balls.parent.rglob(f"seed_{seed}_*/row.json")]
        shown = json.loads((balls.parent / f"shown_{seed}.json").read_text())
        assert digest(task.mesh.V.tobytes()) in shown["found"]
        assert not answers & set(shown["found"])
        assert (shown["truth"], shown["name"], shown["meta"]) == (None, row["task.checksum"], {})
        # The result is the rest shape, and the row tells how far it is from the truth.
        assert row["metric.truth_distance"] > 1 and row["task.meta.posed_by"] == task.meta["posed_by"]

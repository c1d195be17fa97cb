"""Methods of others look for the true pose, or attack measures, clocks and other methods, in vain."""

import json
import re

import numpy as np
import pytest

from baselines.identity import identity
from defaust.build.dataset import build
from defaust.tasks import load_task
from eval.main import main
from eval.metrics import measure
from eval.rows.collect import collect
from eval.rows.frame import records
from eval.rows.store import TRUE_POSE
from eval.run.environment import digest
from sshade.files.meshes import read_mesh
from tests.defaust.toy import OPTIONS, Balls
from tests.full import few

#: `peeking` lists what it was given, and all arrays of positions that it can reach: in objects that the
#: garbage collector knows, in modules and their caches, and in the local variables of its callers.
METHODS = """
import gc
import json
import os
import sys
import time
from contextlib import suppress
from multiprocessing.connection import Connection

import numpy as np

import eval.metrics
import eval.run.attempt
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
    shown["arguments"] = sys.argv[1:]
    with open(f"shown_{seed}.json", "w") as file:
        json.dump(shown, file)
    return at_rest(task)


def at_rest(task, **told):
    return DeformationResult(task.mesh.V, iterations=0, converged=None, **told)


def ending(task, *, seed, progress):
    os._exit(0)


def leaving(task, *, seed, progress):
    \"\"\"End the process, while a child of it keeps the connection to the evaluator open.\"\"\"
    if os.fork() == 0:
        time.sleep(20)
    os._exit(0)


def poisoning(task, *, seed, progress):
    for thing in (task, task.mesh, task.handles):
        vars(thing).update(diagonal=1e9, n=1, index=np.zeros(1, dtype=int))
    vars(task.mesh)["V"] = np.zeros(task.mesh.V.shape)
    return at_rest(task)


def lying(task, *, seed, progress):
    time.sleep(0.5)
    for name, metric in eval.metrics.METRICS.items():
        vars(metric)["function"] = lambda deformed: 0.0
    eval.run.attempt.perf_counter = eval.run.attempt.process_time = time.perf_counter = lambda: 1.0
    return at_rest(task)


class Order(float):
    def __reduce__(self):
        return open, ("pickled", "w")


def pickling(task, *, seed, progress):
    progress("a stage", None, "many")
    return at_rest(task, extra={"order": Order(1), "n\\ud800": 2, "long": 10**5000})


def forging(task, *, seed, progress):
    facts = {"method.name": "identity", "key": "0", "date": "9999", "metric.edge": 0.0, "seconds.total": 0.0}
    facts |= {"iterations": 1, "converged": True, "peak_mib": 1}
    (connection,) = [thing for thing in gc.get_objects() if isinstance(thing, Connection)]
    for text in (["ready"], ["result", facts]):
        connection.send_bytes(json.dumps(text).encode())
    connection.send_bytes(task.mesh.V.tobytes())
    time.sleep(60)


def shouting(task, *, seed, progress):
    for number in range(3, 30):
        with suppress(OSError):
            os.write(number, b"\\0\\0\\0\\3abc")
    time.sleep(60)
"""
#: Attacks, and the end of the line about the run.
ATTACKS = {
    "ending": "failed (the process ended with exit code 0)",
    "leaving": "failed (the process ended with exit code 0)",
    "shouting": "failed (the method wrote into the connection of its process)",
    "forging": "failed (the method's extra['options'] has 'name', which the evaluator writes)",
    **dict.fromkeys(("poisoning", "lying", "pickling"), "iterations"),
}
SWEEP = "run -m --config-dir conf dataset.root=balls subject=1 pose=2 method="


@pytest.fixture
def balls(here):
    """A dataset whose poses are not rigid, and the methods; they are in the working folder."""
    build(Balls(stretch=1.5), here / "balls", options=OPTIONS, workers=1)
    (here / "mymethods.py").write_text(METHODS)
    (here / "conf/method").mkdir(parents=True)
    for name in ("peeking", *ATTACKS):
        text = f"_target_: mymethods.{name}\n_partial_: true\nwarm_up: null\n"
        (here / f"conf/method/{name}.yaml").write_text(text)
    return here / "balls"


@pytest.mark.parametrize("resolution", few(["high", "low"], "high"))
def test_no_method_finds_the_truth_in_its_process(balls, resolution):
    assert main([*SWEEP.split()[:-1], "method=peeking", "seed=0,1", f"dataset.resolution={resolution}"]) == 0
    task = load_task(balls, subject=1, pose=2, resolution=resolution)
    registered = read_mesh(balls / "subject_01/pose_2_low.ply")
    answers = {digest(np.ascontiguousarray(V).tobytes()) for V in (task.truth, registered.V)}
    for seed in (0, 1):  # the truth of the first run has been in memory before the second
        paths = balls.parent.rglob(f"peeking/*/seed_{seed}_*/row.json")
        (row,) = [json.loads(path.read_text()) for path in paths]
        shown = json.loads((balls.parent / f"shown_{seed}.json").read_text())
        assert digest(task.mesh.V.tobytes()) in shown["found"]
        assert not answers & set(shown["found"])
        assert (shown["truth"], shown["name"], shown["meta"]) == (None, row["task.checksum"], {})
        assert shown["arguments"] == []
        # The result is the rest shape, and the row tells how far it is from the truth.
        assert row["metric.truth_distance"] > 1 and row["task.meta.posed_by"] == task.meta["posed_by"]


def test_no_method_changes_measures_clocks_or_other_runs(balls, capfd):
    assert main(f"{SWEEP}{','.join([*ATTACKS, 'identity'])}".split()) == 1
    lines = [re.sub(r" \(about .* left\)", "", line) for line in capfd.readouterr().out.splitlines()]
    assert len(lines) == 8 and lines[0].startswith("[1/8] ending on ")
    assert [line for line, end in zip(lines, ATTACKS.values(), strict=False) if not line.endswith(end)] == []
    rows = {row["method.name"]: row for row in records(collect(balls.parent / "out/runs/single"))}
    assert {*rows} == {*ATTACKS, "identity", TRUE_POSE}
    task = load_task(balls, subject=1, pose=2)
    shapes = {"poisoning": 0 * abs(task.mesh.V), "identity": identity(task).vertices}
    for name in ("poisoning", "lying", "pickling", "identity"):
        measured = measure(task, shapes.get(name, task.mesh.V))
        assert {metric: rows[name][f"metric.{metric}"] for metric in measured} == measured
        assert rows[name]["seconds.total"] > 0 and rows[name]["date"] < "9999"
    assert 0.5 < rows["lying"]["seconds.total"] < 5
    assert rows["pickling"]["extra.order"] == 1 and not (balls.parent / "pickled").exists()
    assert rows["pickling"]["extra.n\\ud800"] == 2 and "extra.long" not in rows["pickling"]

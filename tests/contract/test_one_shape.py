"""Every option of a method has one effect from every entry: arrays, tasks, bound meshes, poses, commands."""

from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import trimesh

from sshade import DeformationTask, Deformer, Handles, deform, deform_sequence
from sshade.cli.main import main
from sshade.files.meshes import read_arrays, write_mesh
from sshade.files.task_files import write_handles
from sshade.problem.options import GROUPS, accepted
from tests.shapes import beside, bumpy, moved_parts, rotation, shifted

ENERGY = {"volume": 1.0, "area": 0.5, "stiffness": 0.2, "strain": 0.1, "strain_limit": 0.02}
ENERGY |= {"attachment": 3.0, "bending": 0.1, "thickness": 1.0, "joints": 0.0}
POLISH = {"detail": 0.9, "proxy_attachment": 2.0, "proxy_bending": 0.1, "proxy_stiffness": 0.5}
#: Options that are given together, with other values than the defaults, and the method that gets them.
TOGETHER = [
    ("fast", {"vertices": 90, "samplings": 2, "frames": "triangle", "workers": 2, "seed": 5}),
    ("fast", {"coarser": 2}),
    ("fast", ENERGY | {"tolerance": 1e-2}),
    ("fast", {"volume_goal": 1.2}),
    ("fast", {"max_iterations": 3, "start": "rest", "guide_attachment": 0.0}),
    ("paper", {"samplings": 2, "seed": 5, "accelerate": False}),
    ("fine", POLISH | {"polish_iterations": 2}),
    ("fine", {"attachment": 3.0, "bending": 0.1, "stiffness": 0.5, "joints": 0.0, "tolerance": 1e-2}),
]
#: Options that change no result. Parts of bound meshes meet a goal less exactly.
SAME, LESS_EXACT = {"workers"}, {"volume_goal"}
#: Few vertices, so that one proxy differs from another, and few iterations.
BASE = {"vertices": 120}


def bent_bodies(count: int) -> DeformationTask:
    """Bodies beside each other, bent by hard handles; the second one by soft handles and a rotation."""
    mesh = beside(*(shifted(bumpy(3), [4 * k, 0, 0]) for k in range(count)))
    ends, kinds = [], ([np.inf, np.inf, np.inf, 4.0], [None, None, None, rotation(1)])
    for k in range(count):
        own = np.flatnonzero(mesh.component == k)
        own = own[np.argsort(mesh.V[own, 2])]
        middle = mesh.V[own].mean(axis=0)
        turned = lambda V, c=middle: c + 0.8 * (V - c) + 0.2 * (V - c) @ rotation(1).T + [0.1, 0.05, 0.1]  # noqa: E731
        ends += [(own[:8], 0), (own[-8:], turned)]
    weights, rotations = (kind[: len(ends)] for kind in kinds)
    own = moved_parts(mesh.V, *ends, weights=weights, rotations=rotations if count > 1 else None)
    # One group, as arrays give them.
    return DeformationTask(
        f"{count} bodies", mesh, Handles(own.index, own.target, weight=own.weight, rotation=own.rotation)
    )


ONE, TWO = bent_bodies(1), bent_bodies(2)


def from_arrays(method: str, **options) -> np.ndarray:
    own = TWO.handles
    given = {"weight": own.weight, "rotations": own.rotation}
    return deform(TWO.mesh.V, TWO.mesh.F, own.index, own.target, method=method, **given, **options)


def from_a_mesh_of_trimesh(method: str, **options) -> np.ndarray:
    own, mesh = ONE.handles, trimesh.Trimesh(ONE.mesh.V, ONE.mesh.F, process=False)
    return np.asarray(deform(mesh, own.index, own.target, method=method, **options).vertices)


def bound(method: str, call: str, **options) -> np.ndarray:
    own = ONE.handles
    drag = Deformer(ONE.mesh, own.index, weight=own.weight, method=method, **options)
    return getattr(drag, call)(own.target).vertices


def first_pose(method: str, **options) -> np.ndarray:
    return next(iter(deform_sequence(ONE, [ONE.handles], method=method, **options))).vertices


def by_command(method: str, **options) -> np.ndarray:
    words = [f"--{name.replace('_', '-')}={value}" for name, value in options.items() if name != "accelerate"]
    words += ["--no-accelerate"] * (not options.get("accelerate", True))
    with TemporaryDirectory() as folder:
        write_mesh(f"{folder}/rest.ply", TWO.mesh.V, TWO.mesh.F)
        write_handles(f"{folder}/pose.json", TWO.handles)
        files = [f"{folder}/rest.ply", f"{folder}/pose.json", "-o", f"{folder}/out.ply"]
        assert main(["deform", *files, "--method", method, *words]) == 0
        return read_arrays(Path(folder, "out.ply"))[0]


#: Entries, and their tasks. A bound mesh keeps the state of its last solve between the parts of TWO.
ENTRIES = {
    "arrays": (TWO, from_arrays),
    "trimesh": (ONE, from_a_mesh_of_trimesh),
    "command": (TWO, by_command),
    "solve": (ONE, partial(bound, call="solve")),
    "step": (ONE, partial(bound, call="step")),
    "pose": (ONE, first_pose),
}


def test_every_option_is_tried():
    assert {name for _, options in TOGETHER for name in options} >= {*accepted("fast"), *GROUPS["Polish"]}


@pytest.mark.parametrize(("method", "options"), TOGETHER)
def test_an_option_has_the_same_effect_from_every_entry(method, options):
    own = ({} if "coarser" in options else BASE) | options
    expected = {task.name: deform(task, method=method, **own).vertices for task in (ONE, TWO)}
    task = TWO if options.keys() <= LESS_EXACT else ONE
    for name in options:
        without = deform(task, method=method, **own | {name: None}).vertices
        change = np.abs(without - expected[task.name]).max()
        assert (change > 1e-6) == (name not in SAME), name
    for name, (task, call) in ENTRIES.items():
        if name == "step" and method == "fine":
            continue  # its steps are those of its proxy
        gap = np.abs(call(method, **own) - expected[task.name]).max()
        assert gap <= (0.1 * change if options.keys() <= LESS_EXACT else 1e-7), f"{name}: {gap:.1e}"

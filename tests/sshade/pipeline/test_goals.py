"""Goals for the volume of a mesh and of its parts."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

import sshade
from sshade import DeformationTask, Deformer, Handles, InputError, Mesh, VolumeGoal
from sshade.cli.main import main
from sshade.io.handles import read_task
from sshade.io.meshes import write_mesh
from sshade.solver.capped import CappedVolume
from sshade.solver.local_global import local_global
from tests.shapes import beside, bumpy, end_handles, icosphere, shifted, tube

BODY = bumpy(3)
#: Largest relative error of the volumes of the whole and of a part.
WHOLE, PART = 1e-3, 1e-2


def side(mesh: Mesh, axis: int = 2) -> np.ndarray:
    """Return the faces in the middle of the mesh along an axis."""
    x = mesh.V[mesh.F].mean(axis=1)[:, axis]
    low, high = x.min(), x.max()
    return np.flatnonzero(np.abs((x - low) / (high - low) - 0.5) < 0.2)


def task_of(mesh: Mesh, *goals: VolumeGoal, count: int = 12) -> DeformationTask:
    """Return a task with handles at both ends along z; the upper end is moved."""
    handles = end_handles(mesh.V, count=count, shift=[0.3, 0, 0.3])
    return DeformationTask("t", mesh, handles, volumes=goals)


def ratio(mesh: Mesh, V: np.ndarray, faces: np.ndarray | None = None) -> float:
    volume = CappedVolume(mesh.F if faces is None else mesh.F[faces])
    return float(volume.measure(V)[0] / volume.measure(mesh.V)[0])


@pytest.mark.parametrize("faces", ["closed", "half", "scattered"])
def test_the_gradient_of_a_capped_volume_is_the_difference_and_a_sphere_scales(faces):
    mesh, rng = icosphere(2), np.random.default_rng(0)
    chosen = {"closed": np.arange(mesh.m), "half": np.arange(mesh.m // 3)}
    volume = CappedVolume(mesh.F[chosen.get(faces, rng.random(mesh.m) < 0.6)])
    V, Z, step = mesh.V + rng.normal(size=mesh.V.shape) * 0.1, rng.normal(size=mesh.V.shape), 1e-5
    G = np.zeros_like(V)
    volume.add_gradient(V, 2.0, G)
    difference = (volume.measure(V + step * Z)[0] - volume.measure(V - step * Z)[0]) / step
    assert np.einsum("ic,ic->", G, Z) == pytest.approx(difference, rel=1e-6)
    assert volume.measure(3.0 * V + 5.0)[0] == pytest.approx(27.0 * volume.measure(V)[0], rel=1e-9)
    assert (volume.loops == 0) == (faces == "closed")


@pytest.mark.parametrize("goal", [{"ratio": 1.5}, {"volume": 0.5}])
def test_a_part_of_a_component_without_handles_has_no_goal(goal):
    mesh = beside(BODY, shifted(BODY, [4.0, 0, 0]))
    part = VolumeGoal(**goal, faces=side(BODY) + BODY.m, name="head")
    task = DeformationTask("t", mesh, task_of(BODY).handles, carry_unconstrained=True, volumes=[part])
    with pytest.raises(InputError, match="head.* lies on components without handles, which keep their shape"):
        sshade.deform(task, vertices=60)


def test_an_open_cylinder_has_the_volume_of_a_closed_one():
    mesh = tube(400, 5)
    assert CappedVolume(mesh.F).measure(mesh.V)[0] == pytest.approx(6.0 * np.pi, rel=1e-3)


def test_the_solver_ends_where_a_general_one_does():
    mesh = icosphere(0)
    faces = np.flatnonzero(mesh.V[mesh.F].mean(axis=1)[:, 0] > 0.3)
    part, whole = CappedVolume(mesh.F[faces]), CappedVolume(mesh.F)
    task = task_of(mesh, VolumeGoal(ratio=1.3, faces=faces), count=2)
    options = {"volume": np.inf, "volume_goal": 1.1, "tolerance": 1e-11, "max_iterations": 3000}
    found = local_global(task, **options)
    free = np.setdiff1d(np.arange(mesh.n), task.handles.index)

    def placed(x):
        V = found.vertices.copy()
        V[free] = x.reshape(-1, 3)
        return V

    def energy(x):
        alone = replace(task, guess=placed(x), volumes=())
        return local_global(alone, max_iterations=0).extra["energy"]

    def error(volume, goal):
        rest = volume.measure(mesh.V)[0]
        return {"type": "eq", "fun": lambda x: volume.measure(placed(x))[0] / rest - goal}

    start = found.vertices[free] + np.random.default_rng(0).normal(size=(len(free), 3)) * 0.01
    constraints = [error(part, 1.3), error(whole, 1.1)]
    other = minimize(energy, start.ravel(), method="SLSQP", constraints=constraints, options={"ftol": 1e-10})
    assert found.extra["volume_error"] < 1e-9 and found.extra["volume_constraint"] == "exact"
    assert found.extra["energy"] == pytest.approx(other.fun, rel=1e-5)


MESHES = {
    "closed": BODY,
    "open": tube(16, 40),
    "two": beside(BODY, shifted(BODY, [6.0, 0, 0])),
    "regions": BODY,
}


@pytest.mark.parametrize("method", ["fast", "fine", "paper"])
@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("part", [False, True])
def test_goals_are_reached_with_handles_on_their_targets(name, method, part):
    mesh, count = MESHES[name], {"regions": 150, "two": 40}.get(name, 12)
    goals = [VolumeGoal(ratio=1.25, faces=side(mesh), name="waist")] if part else []
    options = {"volume": np.inf} if method == "paper" else {}
    result = sshade.deform(task_of(mesh, *goals, count=count), method=method, volume_goal=1.1, **options)
    V = result.vertices
    assert ratio(mesh, V) == pytest.approx(1.1, rel=PART if part else WHOLE)
    assert not part or ratio(mesh, V, side(mesh)) == pytest.approx(1.25, rel=PART)
    assert method == "paper" or result.extra["hard_handle_error"] < 1e-12
    assert result.extra["volume_goal_error"] < PART and result.extra["options"]["volume_goal"] == 1.1


def test_an_absolute_volume_is_of_all_components_and_a_part_leaves_the_rest():
    mesh = MESHES["two"]
    V = sshade.deform(task_of(mesh, VolumeGoal(volume=2.0), count=40)).vertices
    of = mesh.component[mesh.F[:, 0]]
    volumes = [CappedVolume(mesh.F[of == k]).measure(V)[0] for k in (0, 1)]
    assert volumes == pytest.approx([1.0, 1.0], rel=WHOLE)
    faces = side(BODY)
    V = sshade.deform(task_of(BODY, VolumeGoal(ratio=1.3, faces=faces))).vertices
    grown = 0.3 * CappedVolume(BODY.F[faces]).measure(BODY.V)[0]
    assert Mesh(V, BODY.F).volume == pytest.approx(BODY.volume + grown, rel=WHOLE)
    inner = np.arange(BODY.m)  # all faces are the whole
    V = sshade.deform(task_of(BODY, VolumeGoal(ratio=0.9, faces=inner))).vertices
    assert ratio(BODY, V) == pytest.approx(0.9, rel=WHOLE)


def test_faces_are_of_the_arrays_also_with_a_seam_and_an_unused_vertex():
    faces, task = side(BODY), task_of(BODY)
    V = np.concatenate([[[9.0, 9, 9]], BODY.V, BODY.V[BODY.F[7]]])
    F = BODY.F + 1
    F[7] = np.arange(3) + 1 + BODY.n
    F = np.concatenate([[[1, 1, 2]], F])
    b = task.handles.index + 1
    U = sshade.deform(V, F, b, task.handles.target, volumes=[VolumeGoal(ratio=1.2, faces=faces + 1)])
    assert ratio(BODY, U[1 : 1 + BODY.n], faces) == pytest.approx(1.2, rel=PART)


@pytest.mark.parametrize("name", ["closed", "open", "regions"])
def test_a_drag_keeps_goals_which_may_change(name):
    mesh = MESHES[name]
    task = task_of(mesh, VolumeGoal(ratio=1.2, faces=side(mesh)), count=150 if name == "regions" else 12)
    drag = Deformer(mesh, task.handles.index, volumes=task.volumes, volume_goal=1.1)
    rest, target = mesh.V[task.handles.index], task.handles.target
    for step in (0.5, 1.0):
        drag(rest + step * (target - rest), tolerance=1e-4)
    drag.settle()
    V = drag.settle().vertices
    assert (ratio(mesh, V), ratio(mesh, V, side(mesh))) == pytest.approx((1.1, 1.2), rel=PART)
    drag.change_energy(volume_goal=1.15)
    V = drag.settle().vertices
    assert (ratio(mesh, V), ratio(mesh, V, side(mesh))) == pytest.approx((1.15, 1.2), rel=PART)
    with pytest.raises(InputError, match="needs a weight"):
        drag.change_energy(volume=0)
    assert ratio(mesh, drag.settle().vertices) == pytest.approx(1.15, rel=PART)


FEW = np.arange(200)
BAD = {
    "an endless goal": ({"volume_goal": np.inf}, [], "volume_goal must be a number above 0"),
    "no weight": ({"volume_goal": 1.1, "volume": 0}, [], "volume_goal needs a weight"),
    "no weight of parts": ({"volume": 0}, [(1.1, FEW)], "volume goals need a weight"),
    "overlap": ({}, [(1.1, FEW), (1.1, FEW[50:])], "150 faces in common"),
    "out of range": ({}, [(1.1, [BODY.m])], "but the mesh has faces 0 to"),
    "a mask of vertices": ({}, [(1.1, BODY.V[:, 1] > 0)], f"has a mask of {BODY.n} faces, but the mesh has "),
    "the whole": ({"volume_goal": 1.2}, [(1.1, np.arange(BODY.m))], "whose goal is 1.2 and not 1.1"),
    "two wholes": ({"volume_goal": 1.2}, [(1.1, None)], "two volume goals"),
    "all parts": ({"volume_goal": 2}, [(1.1, FEW), (1.1, np.arange(200, BODY.m))], "add up to 1.1 and not 2"),
    "a flat part": ({}, [(1.1, [3])], "no volume at rest"),
    "a small part": ({"vertices": 40}, [(1.1, FEW[:9])], "smaller than the proxy's triangles"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_goals_are_refused_in_one_sentence(name):
    options, goals, words = BAD[name]
    with pytest.raises(InputError, match=words):
        parts = [VolumeGoal(ratio=goal, faces=faces) for goal, faces in goals]
        sshade.deform(task_of(BODY, *parts), **options)


def test_more_goals_than_movable_vertices_are_refused():
    mesh, parts = icosphere(1), [VolumeGoal(ratio=1.1, faces=np.arange(k, k + 20)) for k in (0, 20)]
    task = DeformationTask("t", mesh, Handles(np.arange(40), mesh.V[:40]), volumes=parts)
    with pytest.raises(InputError, match="3 volume goals are too many for a proxy with 2 vertices"):
        sshade.deform(task)


ENTRIES = {
    "good": ({"name": "waist", "boxes": [[[-9, -9, -0.5], [9, 9, 0.5]]], "goal": 1.2}, ""),
    "a whole": ({"volume": 7}, ""),
    "negative": ({"goal": -1}, "volume 0: the volume goal of the mesh must be a finite number above 0"),
    "no number": ({"goal": "1"}, "must be a finite number above 0, not '1'"),
    "no goal": ({"faces": [1]}, "needs either a ratio (in a file"),
    "no faces": ({"vertices": [1], "goal": 1.2}, "volume 0: the volume goal of a part has no faces"),
    "two ways": ({"faces": [1], "vertices": [1], "goal": 2}, 'either as "faces" or as "vertices"'),
    "a key": ({"gaol": 2}, 'did you mean "goal"?'),
}


@pytest.mark.parametrize("name", ENTRIES)
def test_handle_files_have_goals(name, tmp_path, capsys):
    entry, words = ENTRIES[name]
    order = np.argsort(BODY.V[:, 2]).tolist()
    moved = {"vertices": order[-9:], "translation": [0, 0, 0.2]}
    content = {"handles": [{"vertices": order[:9]}, moved], "volumes": [entry]}
    (tmp_path / "h.json").write_text(json.dumps(content))
    write_mesh(tmp_path / "m.ply", BODY.V, BODY.F)
    files = [str(tmp_path / name) for name in ("m.ply", "h.json", "out.ply")]
    code = main(["deform", *files[:2], "-o", files[2]])
    assert (code, words in capsys.readouterr().err) == (2 if words else 0, True)
    if not words:
        (goal,) = read_task(files[0], handles=files[1]).volumes
        V, _ = sshade.read(files[2])
        assert ratio(BODY, V, goal.faces) == pytest.approx(
            goal.ratio or 7 / BODY.volume, rel=WHOLE if goal.faces is None else PART
        )

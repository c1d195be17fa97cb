"""What the command says: missed targets, rounded positions, surfaces that come apart, and odd handles."""

import json
import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import trimesh

from sshade import Handles
from sshade.cli.main import main
from sshade.cli.notes import handle_notes
from sshade.core import threads
from sshade.files.handle_files import HandleFile
from sshade.files.meshes import read_arrays, write_mesh
from sshade.files.task_files import write_handles
from sshade.problem.handle_checks import astray
from tests.robustness.case import run
from tests.robustness.inputs import BODY, pose
from tests.shapes import beside, block, end_handles, icosphere, shifted, tube
from tests.write import obj

POSE = pose(BODY.V)
FAR = 1e5 * BODY.diagonal * np.array([1, 0.5, -0.7])


@pytest.fixture
def said(sound, capsys):
    """Deform a mesh file of the folder; return what is said."""

    def said(output: str, *options: str, mesh: str = "body.ply", handles: Handles = POSE) -> str:
        write_handles("pose.json", handles)
        assert main(["deform", mesh, "pose.json", "-o", output, "--vertices", "60", *options]) == 0
        return capsys.readouterr().err

    return said


def said_to_be_reached(err: str) -> float:
    """Return the fraction of the diagonal in the summary."""
    found = re.search(r"handles at most (\S+) % of the diagonal from target, ", err)
    assert found or "handles on target, " in err
    return float(found[1]) / 100 if found else 0.0


def largest_error(path: str, handles: Handles, diagonal: float) -> float:
    distance = np.linalg.norm(read_arrays(path)[0][handles.index] - handles.target, axis=1)
    return distance.max() / diagonal


@pytest.mark.parametrize("method", ["paper", "fine", "fast --volume 0 --area 0"])
def test_hard_handles_that_miss_are_a_warning(said, method):
    err = said("out.ply", "--method", *method.split())
    error = largest_error("out.ply", POSE, BODY.diagonal)
    assert said_to_be_reached(err) == pytest.approx(error, rel=0.06, abs=1e-6)
    if method == "paper":
        assert error > 1e-4
        percent = f"{100 * error:.2g}"
        assert f"warning: a handle is {percent} % of the diagonal away from its target; --method fast" in err
    else:
        assert error < 1e-9 and "warning" not in err


def test_soft_handles_are_counted_apart_and_are_no_warning(said):
    weight = np.where(np.arange(len(POSE)) < 3, 0.5, np.inf)
    target = POSE.target + 0.1 * weight[:, None].clip(max=1)
    err = said("out.ply", handles=Handles(POSE.index, target, weight=weight))
    assert f"{len(POSE) - 3} handles on target, 3 soft handles " in err and "warning" not in err
    err = said("out.ply", "--weight", "1")
    assert f"out.ply: {BODY.n} vertices, {len(POSE)} soft handles " in err


def test_far_from_the_origin_the_distance_is_that_of_the_stored_positions(said):
    """The mesh is in double precision; glTF rounds it to steps of about 1 % of the diagonal."""
    write_mesh("body.ply", BODY.V + FAR, BODY.F)
    far = Handles(POSE.index, POSE.target + FAR)
    err = said("out.obj", handles=far)
    assert said_to_be_reached(err) < 1e-9 and "single precision" not in err
    err = said("out.glb", handles=far)
    reached = largest_error("out.glb", far, BODY.diagonal)
    assert said_to_be_reached(err) == pytest.approx(reached, rel=0.06) and reached > 1e-3
    assert "note: out.glb stores single precision, which moves positions by up to" in err
    assert "warning" not in err  # the method is exact; only the format rounds


TUBE = tube(12, 8, length=2.0)
CHAIN = beside(*(shifted(TUBE, [0, 0, 1.7 * k]) for k in range(5)))
NAMES = ["foot", "leg", "seat", "back", "head"]


def put_pose(name: str, shift: float) -> None:
    low = {"name": "low", "kind": "fixed", "vertices": list(range(12))}
    high = {"vertices": list(range(CHAIN.n - 12, CHAIN.n)), "translation": [shift, 0, 0]}
    Path(name).write_text(json.dumps({"handles": [low, {"name": "high", **high}]}))


def write_chain(suffix: str) -> None:
    if suffix == ".ply":
        write_mesh("chain.ply", CHAIN.V, CHAIN.F)
    elif suffix == ".obj":
        text = obj(CHAIN.V, CHAIN.F).decode().splitlines()
        for k in reversed(range(5)):
            text.insert(CHAIN.n + k * TUBE.m, f"g {NAMES[k]}")
        Path("chain.obj").write_text("\n".join(text))
    else:
        scene = trimesh.Scene()
        for k, name in enumerate(NAMES):
            part = trimesh.Trimesh(shifted(TUBE, [0, 0, 1.7 * k]).V, TUBE.F, process=False)
            scene.add_geometry(part, node_name=name, geom_name=f"mesh {k}")
        scene.export("chain.glb")


@pytest.mark.parametrize(
    ("suffix", "names"),
    [
        (".ply", "the part of vertex 96 and the part of vertex 192"),
        (".obj", '"leg" (vertex 96) and "seat" (vertex 192)'),
        (".glb", '"seat" (vertex 192) and "back" (vertex 288)'),
    ],
)
def test_a_chain_of_tubes_that_overlap_reports_where_it_opens(here, suffix, names, capsys):
    write_chain(suffix)
    put_pose("pose.json", 3.0)
    assert main(["deform", f"chain{suffix}", "pose.json", "-o", f"out{suffix}"]) == 0
    said = capsys.readouterr().err
    assert f"came apart by up to 24 % of the diagonal: {names}; give them common handles" in said
    if suffix == ".ply":  # of all poses, the widest gap
        put_pose("pose_2.json", 0.01)
        assert main(["deform", "chain.ply", "pose_2.json", "-o", "out.ply"]) == 0
        assert "came apart" not in capsys.readouterr().err
        assert main(["deform", "chain.ply", "pose_2.json", "pose.json", "-o", "out_%d.ply"]) == 0
        assert "came apart by up to 24 %" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("mesh", "long"),
    [
        (trimesh.creation.box((1, 1, 6)), True),
        (trimesh.creation.cylinder(1, 6, sections=12), True),
        (block(np.ones((1, 1, 6)), cells=4), False),
        (tube(24, 40), False),
        (icosphere(2), False),
    ],
    ids=["box", "cylinder", "fine box", "fine tube", "ball"],
)
def test_triangles_that_are_too_long_to_bend_are_named(here, mesh, long, capsys):
    """The long sides of the box are two triangles each."""
    V, F = (mesh.vertices, mesh.faces) if long else (mesh.V, mesh.F)
    write_mesh("a.ply", V, F)
    write_handles("a.json", end_handles(V, share=0.15))
    assert main(["deform", "a.ply", "a.json", "-o", "b.ply"]) == 0
    said = capsys.readouterr().err
    assert ("a surface bends at its vertices alone: subdivide it" in said) == long


def test_faces_inside_of_a_solid_are_hinted_at(here):
    """The faces of all cubes of a block, as a mesh of a solid has them."""
    cube = block(np.ones((1, 1, 1), dtype=bool))
    parts = [cube.V + [i, j, k] for i in range(4) for j in range(4) for k in range(4)]
    W, vertex = np.unique(np.concatenate(parts), axis=0, return_inverse=True)
    faces = np.concatenate([cube.F + k * cube.n for k in range(64)])
    write_mesh("a.ply", W, vertex.ravel()[faces])
    Path("pose.json").write_text('{"handles": [{"vertices": [0, 60]}, {"vertices": [124], "scale": 2}]}')
    code, _, err = run("sshade deform a.ply pose.json -o out.ply")
    assert code == 0 and "more than two faces meet at an edge in most of the mesh, as faces inside" in err


def test_handles_that_shrink_together_are_not_astray():
    rest = icosphere(3).V
    target = 0.01 * rest
    target[::50] += [0.03, 0, 0]  # far for the shrunk ones, and near for the size that they had
    assert len(astray(rest, target)) == 0 < len(astray(rest, 100 * target))


@pytest.mark.parametrize("method", ["fast", "interpolate"])
def test_handles_that_contradict_their_neighbours_are_named(here, method):
    body = icosphere(4)
    write_mesh("a.ply", body.V, body.F)
    ids = np.arange(0, body.n, 10)
    target = body.V[ids] + 0.3 * np.sin(2 * body.V[ids, ::-1])
    wrong = [10, 100, 200]
    for exchanged in (False, True):
        if exchanged:
            target[wrong] = target[np.roll(wrong, 1)]
        write_handles("pose.json", Handles(ids, target))
        code, _, err = run(f"sshade deform a.ply pose.json -o out.ply --method {method}")
        named = f"vertex {', '.join(map(str, ids[wrong]))}; check the order of the targets"
        told = "3 handles go far from where neighbours go" in err and named in err
        assert code == 0 and told == exchanged


@pytest.mark.parametrize("method", ["fast", "interpolate"])
@pytest.mark.parametrize("every", [2, 160])
def test_a_method_that_does_not_fit_the_density_of_the_handles_is_told(here, method, every):
    body = icosphere(3)
    write_mesh("a.ply", body.V, body.F)
    ids = np.arange(0, body.n, every)
    write_handles("pose.json", Handles(ids, body.V[ids] + [0, 0, 0.1] * body.V[ids]))
    _, _, err = run(f"sshade deform a.ply pose.json -o out.ply --method {method}")
    assert ("note: the handles are dense" in err) == (every == 2 and method == "fast")
    assert ("note: the handles are not dense" in err) == (every == 160 and method == "interpolate")


def test_notes_on_the_handles_of_a_large_mesh_take_memory_for_a_part_of_it(monkeypatch):
    monkeypatch.setattr(threads, "available_cpus", lambda: 1)
    mesh = icosphere(7)
    assert mesh.face_areas.all()  # the method has computed them before
    handles = Handles([0, 5], mesh.V[[0, 5]] + [[0, 0, 0], [0, 0, 0.1]], group=[0, 1], dynamic=[False, True])
    tracemalloc.start()
    assert handle_notes(HandleFile((), raw=False), handles, mesh) == []
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 200 * mesh.n  # all sides at once take 500 bytes a vertex

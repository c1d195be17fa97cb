"""Registered sequences: layouts, formats, one list of triangles a class, and refused input."""

import pickle
from functools import partial

import numpy as np
import pytest
from scipy.io import savemat

from defaust.build.dataset import build
from defaust.build.verify import verify
from defaust.cli import main
from defaust.folder.record import read_dataset
from defaust.sources.winding import same_triangles
from defaust.tasks import list_tasks, load_task
from sshade import InputError, Mesh
from sshade.files.meshes import write_mesh
from tests.defaust.registrations import configured
from tests.defaust.toy import KEPT
from tests.shapes import beside, icosphere, shifted, strip, torus
from tests.sshade.mesh.test_cutting import moebius

sequence = partial(configured, "sequence")
SMALL = ["handles_per_landmark=6", "neighbourhood=10", "workers=1"]


def bent(mesh, k):
    """Return the vertices of pose k: a shear above y = 0, which keeps the vertices in correspondence."""
    return mesh.V + 0.2 * k * np.maximum(0.0, mesh.V[:, 1:2]) * [1.0, 0, 0]


def write(folder, name, V, F, *, kind=".ply"):
    folder.mkdir(parents=True, exist_ok=True)
    if kind == ".vert":
        np.savetxt(folder / f"{name}.vert", V, fmt="%.17g")
        np.savetxt(folder / f"{name}.tri", F + 1, fmt="%d")
    elif kind == ".mat":
        surface = {"X": V[:, :1], "Y": V[:, 1:2], "Z": V[:, 2:], "TRIV": (F + 1).astype(np.uint16)}
        savemat(folder / f"{name}.mat", {"surface": surface})
    else:
        write_mesh(folder / f"{name}{kind}", V, F)


def write_class(folder, name, mesh, *, poses=(0, 1, 2), kind=".ply"):
    for k in poses:
        write(folder, f"{name}{k}", bent(mesh, k), mesh.F, kind=kind)
    return folder


@pytest.mark.parametrize("kind", [".off", ".vert", ".mat"])
def test_classes_are_read_in_every_format(tmp_path, kind):
    ball, ring = icosphere(2), torus()
    write_class(tmp_path, "dog", ball, poses=(0, 2, 10), kind=kind)
    write_class(tmp_path, "cat", ring, poses=(0, 1), kind=kind)
    (tmp_path / "readme.txt").write_text("not a mesh")
    source = pickle.loads(pickle.dumps(sequence(tmp_path)))
    assert source.subjects == (0, 1) and source.provenance["classes"] == ["cat", "dog"]
    assert [p.name for p in source.poses(1)] == ["dog2", "dog10"]
    np.testing.assert_allclose(source.rest(1).V, ball.V, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(source.rest(1).F, ball.F)
    np.testing.assert_allclose(source.posed(1, source.poses(1)[1]).V, bent(ball, 10), rtol=0, atol=1e-14)
    expected = {f"cat{k}{kind}" for k in (0, 1)} | ({"cat0.tri", "cat1.tri"} if kind == ".vert" else set())
    assert set(source.checksums([0])) == expected
    assert sequence(tmp_path, "source.classes=[dog,cat]").provenance["classes"] == ["dog", "cat"]
    assert sequence(tmp_path, "source.layout=sequence").subjects == (0,)


def test_the_poses_of_one_sequence_are_sorted_by_the_numbers_in_their_names(tmp_path):
    ball = icosphere(1)
    for k, name in enumerate(["Pose_1", "Pose_2", "Pose_10", "Rest"]):
        write(tmp_path / "run", name, bent(ball, k), ball.F, kind=".ply")
    (tmp_path / "run/._Pose_1.ply").write_text("what macOS leaves")
    (tmp_path / "run/Pose_1.off").write_text("PLY takes precedence")
    source = sequence(tmp_path / "run")
    assert list(source.checksums([0])) == ["Rest.ply", "Pose_1.ply", "Pose_2.ply", "Pose_10.ply"]
    assert source.subjects == (0,) and source.provenance["classes"] == ["sequence"]  # not the folder's name
    assert source.provenance["rest_poses"] == ["Rest"]  # whatever its place by name
    assert [p.name for p in source.poses(0)] == ["Pose_1", "Pose_2", "Pose_10"]
    chosen = sequence(tmp_path / "run", "source.poses_used=[Pose_10,Rest]", "source.rest_pose=Pose_2")
    assert [p.name for p in chosen.poses(0)] == ["Rest", "Pose_10"]


def test_triangles_of_a_class_are_reconciled_and_turned_outward(tmp_path):
    ball = icosphere(2)
    rng = np.random.default_rng(0)
    some = rng.random(ball.m) < 0.3
    flipped = np.where(some[:, None], ball.F[:, [0, 2, 1]], ball.F)
    write(tmp_path, "cat0", ball.V, flipped)
    write(tmp_path, "cat1", bent(ball, 1), ball.F[:, [1, 2, 0]][rng.permutation(ball.m)])
    write(tmp_path, "cat2", bent(ball, 2), ball.F[:, ::-1])
    write(tmp_path / "cup", "cup0", ball.V, ball.F[5:, ::-1])
    source = sequence(tmp_path)
    np.testing.assert_array_equal(source.rest(0).F, ball.F)
    for k, pose in enumerate(source.poses(0), start=1):
        np.testing.assert_array_equal(source.posed(0, pose).F, ball.F)
        np.testing.assert_array_equal(source.posed(0, pose).V, bent(ball, k))
    assert sequence(tmp_path / "cup").rest(0).volume > 0.5 * ball.volume  # a hole does not matter


def test_sampled_landmarks_lie_apart_at_the_ends(tmp_path):
    long = strip(40, 4)
    write_class(tmp_path, "band", long)
    source = sequence(tmp_path, "source.landmarks=3")
    found = source.landmark_vertices(0)
    assert list(found) == ["fps_0", "fps_1", "fps_2"] == list(source.landmark_names)
    x = long.V[list(found.values()), 0]
    assert sorted(x[:2]) == [0.0, 40.0] and 15 < x[2] < 25
    for given, words in (("{far:205}", "far is 205, but there are 205 vertices"), ("true", "not an object")):
        with pytest.raises(InputError, match=words):
            sequence(tmp_path, f"source.landmarks={given}").landmark_vertices(0)


def test_the_first_landmark_is_at_an_end_of_the_largest_component(tmp_path):
    pair = beside(strip(3, 3), shifted(strip(40, 4), [0, 9, 0]), shifted(strip(3, 3), [0, 99, 0]))
    write_class(tmp_path, "band", pair)
    first, *others = sequence(tmp_path, "source.landmarks=3").landmark_vertices(0).values()
    assert pair.component[first] == 1 and pair.V[first, 0] in (0.0, 40.0)
    assert {0, 2} == set(pair.component[others].tolist())


def test_vertices_and_faces_outside_the_surface_are_removed(tmp_path):
    ball, out = icosphere(3), tmp_path / "out"
    for k in range(3):  # an unused vertex, a duplicate face, and a face that repeats a vertex
        V, F = np.concatenate([[[9.0, 9, 9]], bent(ball, k)]), ball.F + 1
        write(tmp_path / "data", f"ape{k}", V, np.concatenate([[F[3, ::-1]], F, [[1, 1, 2]]]), kind=".mat")
    source = sequence(tmp_path / "data", "source.landmarks={front: 5, top: 13}")
    assert source.dropped(0) == {"unused_vertices": 1, "faces_that_repeat_a_vertex": 1, "duplicate_faces": 1}
    assert source.landmark_vertices(0) == {"front": 4, "top": 12}
    build(source, out, options=KEPT, workers=1)
    assert verify(out) == [] and "1 unused vertices, 1 faces" in (out / "README.md").read_text()
    task = load_task(out, subject=0, pose=2)
    np.testing.assert_allclose(task.truth, bent(ball, 2), rtol=0, atol=1e-15)
    assert same_triangles(task.mesh.F, ball.F) and task.mesh.volume == pytest.approx(ball.volume)


def test_surfaces_with_holes_or_components_or_not_manifold_are_built(tmp_path):
    ball = icosphere(3)
    a, b = ball.F[0, :2]
    top = ball.V[[a, b]].mean(axis=0) * [[1.5], [1.7]]
    fins = [[a, b, ball.n], [b, a, ball.n + 1]]  # the first edge has four faces
    shapes = {
        "ball": ball,
        "camel": Mesh(np.concatenate([ball.V, top]), np.concatenate([ball.F, fins])),
        "cup": Mesh(ball.V, ball.F[1:]),
        "pair": beside(ball, Mesh(0.5 * ball.V + 3, ball.F)),
        "ring": moebius(60),
    }
    for name, mesh in shapes.items():
        write_class(tmp_path / "data", name, mesh)
    source, out = sequence(tmp_path / "data", "source.landmarks=4"), tmp_path / "out"
    build(source, out, options=KEPT, workers=1)
    assert verify(out) == [] and (out / "README.md").read_text().count("- The meshes of subject ") == 3
    document = read_dataset(out)
    for subject, (name, mesh) in zip(document["subjects"], shapes.items(), strict=True):
        task = load_task(out, subject=subject["subject"], pose=2)
        np.testing.assert_array_equal(task.truth, bent(mesh, 2))
        facts, components = subject["low"], 2 if name == "pair" else 1
        assert facts.get("components", 1) == components
        assert facts.get("oriented_manifold", True) is (name not in ("camel", "ring"))
        with_landmark = task.mesh.component[list(subject["landmark_vertices"].values())]
        assert len(set(with_landmark.tolist())) == components
    with pytest.raises(InputError, match="2 components, .* needs a landmark; set source.landmarks to 2"):
        sequence(tmp_path / "data", "source.landmarks=1").landmark_vertices(3)


def test_an_unusable_mesh_does_not_stop_the_build(tmp_path, caplog, refused):
    root, out, ball = tmp_path / "data", tmp_path / "out", icosphere(3)
    for name in ("cat", "dog", "gorilla", "wolf"):
        write_class(root, name, ball)
    write(root, "horse0", torus().V, torus().F)
    write(root, "credits", ball.V, ball.F)
    (root / "dog1.ply").write_text("damaged on its way")
    command = ["source=tosca", f"source.root={root}", *SMALL, "source.landmarks=4"]
    refused([*command, f"out={out}"], "credits: its name does not read as a class")
    assert not out.exists()
    caplog.clear()
    assert main(["build", *command, f"out={out}", "strict=false"]) == 0
    reasons = (
        "gorilla, wolf, as ",
        "credits: its name does not read as a class and a number, like cat0",
        "horse: it has no target pose besides its rest pose",
        "subject 1, pose 1: dog1.ply:",
    )
    for record, reason in zip(caplog.records, reasons, strict=True):
        assert record.getMessage().startswith(f"left out: {reason}")
    assert list_tasks(out) == [(0, 1), (0, 2), (1, 2)]
    card = (out / "README.md").read_text()
    assert all(f"Left out: {reason}" in card for reason in reasons)


def test_meshes_out_of_correspondence_are_refused_by_name(tmp_path):
    ball = icosphere(2)
    write_class(tmp_path, "cat", ball, poses=(0,))
    write(tmp_path, "cat1", torus().V, torus().F)
    swapped = ball.F.copy()
    swapped[swapped == 0], swapped[ball.F == 1] = 1, 0
    write(tmp_path, "cat2", ball.V, swapped)
    write(tmp_path, "cat3", np.where(ball.V > 0.99, np.nan, ball.V), ball.F, kind=".ply")
    source = sequence(tmp_path)
    messages = ("cat1.ply: 288 vertices, but the rest pose cat0 has 162",)
    messages += ("cat2.ply: other triangles than the rest pose cat0", "cat3.ply: vertex .* has a NaN")
    for pose, message in zip(source.poses(0), messages, strict=True):
        with pytest.raises(InputError, match=message):
            source.posed(0, pose)

"""The source FAUST: layouts, poses and landmarks, refused files, and a build."""

import pickle
import shutil
from dataclasses import replace

import numpy as np
import pytest

from defaust.build.dataset import build
from defaust.build.doubts import difference
from defaust.cli import main
from defaust.folder.layout import sha256
from defaust.tasks import list_tasks, load_task
from sshade import InputError, Mesh
from sshade.files.meshes import read_mesh, write_mesh
from tests.defaust.registrations import BODIES, POSES, SMALL, faust, write_faust
from tests.shapes import icosphere


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Subject 0 in all five poses, subject 3 without pose 8; do not change it."""
    root = tmp_path_factory.mktemp("faust") / "MPI-FAUST/training/registrations"
    write_faust(root)
    return write_faust(root, subjects=[3], poses=POSES[:4])


@pytest.fixture
def copy(folder, tmp_path):
    """A copy to damage."""
    return shutil.copytree(folder, tmp_path / "registrations")


def arguments(copy):
    out = copy.with_name("out")
    return out, ["source=faust", "target_vertices=null", "workers=1", f"source.root='{copy}'", f"out='{out}'"]


@pytest.mark.parametrize("inside", ["", "MPI-FAUST/training/registrations"])
def test_any_folder_around_the_files_is_accepted(folder, inside):
    source = pickle.loads(pickle.dumps(faust(folder.parents[2] / inside)))
    np.testing.assert_array_equal(source.rest(0).V, BODIES.rest(0).V)
    more = set(source.more_landmarks)
    assert {pose.aligned for pose in source.poses(0)} == {True, False} and more
    assert all((set(pose.landmarks) >= more) == (not pose.aligned) for pose in source.poses(0))
    for pose, expected in zip(source.poses(3)[:3], BODIES.poses(3), strict=False):
        np.testing.assert_array_equal(source.posed(3, pose).V, BODIES.posed(3, expected).V)


def test_missing_files_and_wrong_folders_are_named(folder, tmp_path):
    source = faust(folder)
    with pytest.raises(InputError, match=r"tr_reg_038 is missing; the poses 0, 1, .* for the subjects \[0\]"):
        source.posed(3, source.poses(3)[3])
    for root, message in (
        (tmp_path, r"holds no registrations \(tr_reg_NNN.ply, .off or .obj\)"),
        (tmp_path / "nowhere", "nowhere: no such folder; set source.root=MPI-FAUST"),
        (folder / "tr_reg_000.ply", "is a file; give a folder"),
    ):
        with pytest.raises(InputError, match=message):
            faust(root)


def test_wrong_meshes_are_named(copy):
    rest, ball = BODIES.rest(0), icosphere(2)
    write_mesh(copy / "tr_reg_001.ply", ball.V, ball.F)
    write_mesh(copy / "tr_reg_003.ply", rest.V, rest.F[np.random.default_rng(0).permutation(rest.m)])
    source = faust(copy)
    assert source._faces is source._faces and source._files is source._files  # read once
    first, second, *_ = source.poses(0)
    with pytest.raises(InputError, match="tr_reg_001.ply: 162 vertices and 320 faces, but .* 6890 and 13776"):
        source.posed(0, first)
    with pytest.raises(InputError, match="tr_reg_003.ply: its faces differ from the faces of tr_reg_000"):
        source.posed(0, second)


def test_a_build_lists_its_files_without_paths(copy, tmp_path):
    out = tmp_path / "out"
    options = replace(SMALL, subjects=(0,), target_vertices=None)
    document = build(faust(copy), out, options=options, workers=1)
    files = {name: sha256(copy / name) for name in (f"tr_reg_00{k}.ply" for k in POSES)}
    assert document["source"]["files"] == files and "{poses}" not in str(document["source"])
    assert str(tmp_path) not in (out / "dataset.json").read_text()
    with pytest.raises(InputError, match="source.landmark_vertices.nose was 332 and is now 7"):
        build(faust(copy, "source.landmarks.nose=7"), out, options=options, workers=1)
    (copy / "tr_reg_001.ply").write_bytes((copy / "tr_reg_003.ply").read_bytes())
    with pytest.raises(InputError, match="source.files.tr_reg_001.ply was '.*' and is now '"):
        build(faust(copy), out, options=options, workers=1)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda path: path.write_bytes(path.read_bytes()[:99_999]), "tr_reg_001.ply: "),
        (lambda path: path.unlink(), "tr_reg_001 is missing"),
    ],
    ids=["cut", "missing"],
)
def test_a_damaged_copy_is_refused_or_its_pose_is_left_out(copy, refused, caplog, damage, message):
    damage(copy / "tr_reg_001.ply")
    out, command = arguments(copy)
    refused([*command, "subjects=[0]"], f"subject 0: {message}")
    assert not out.exists()
    caplog.clear()
    assert main(["build", *command, "subjects=[0]", "strict=false"]) == 0
    assert f"left out: subject 0, pose 1: {message}" in caplog.text
    assert list_tasks(out) == [(0, 2), (0, 3), (0, 4)] and load_task(out, subject=0, pose=2).meta["note"]


def of_subject(folder, number, subject, scale=1.0):
    write_faust(folder / "other", subjects=[subject])
    (folder / f"other/tr_reg_{10 * subject + number:03d}.ply").rename(folder / f"tr_reg_00{number}.ply")
    changed(folder, number, lambda V: scale * V)


def changed(folder, number, change):
    path = folder / f"tr_reg_00{number}.ply"
    V, F = read_mesh(path).V.copy(), read_mesh(path).F
    write_mesh(path, change(V), F)


def one_vertex_away(V):
    return V + np.outer(np.arange(len(V)) == 100, [0.5, 0, 0])


def copied(folder, number, other):
    shutil.copy(folder / f"tr_reg_{number:03d}.ply", folder / f"tr_reg_{other:03d}.ply")


#: What happens to the files of a folder, and the beginning of the sentence that refuses them.
NOT_RIGHT = {
    "times as long as at rest: a vertex is out of": lambda folder: changed(folder, 3, one_vertex_away),
    "subject 0, 3_forearms_raised: its edges are th": lambda folder: of_subject(folder, 3, 3, 1.03),
    "tr_reg_008.ply is a copy of tr_reg_003.ply; take": lambda folder: copied(folder, 3, 8),
    "6_arms_forward: it has the vertices of subject 0, 3_": lambda folder: copied(folder, 3, 36),
    "subject 3, the rest pose: it has the vertices of sub": lambda folder: copied(folder, 0, 30),
}


@pytest.mark.parametrize("message", NOT_RIGHT)
def test_a_registration_that_cannot_be_right_is_refused(copy, refused, message):
    NOT_RIGHT[message](copy)
    out, command = arguments(copy)
    refused([*command, "subjects=[0,3]", "source.target_poses=[1,3,6]"], message)
    assert not out.exists()


def test_a_build_that_is_not_strict_takes_a_doubtful_registration(copy, tmp_path):
    changed(copy, 3, one_vertex_away)
    shutil.copy(copy / "tr_reg_000.ply", copy / "tr_reg_006.ply")
    options = replace(SMALL, subjects=(0,), target_vertices=None)
    document = build(faust(copy), tmp_path / "out", options=options, strict=False, workers=1)
    assert [pose["pose"] for pose in document["subjects"][0]["poses"]] == [1, 2, 4]


def test_a_pose_differs_from_the_rest_pose_by_its_edges_and_its_volume():
    ball, factors = icosphere(2), (1e3, 1e-3, [1, 1, 1.3], [1, 1, 0.7])
    texts = "edge is 1e+03", "edge is 0.001", "volume is 1.3", "volume is 0.7"
    for factor, words in zip(factors, texts, strict=True):
        assert f"{words} times" in difference(ball, Mesh(ball.V * factor, ball.F))


@pytest.mark.parametrize(("strict", "of", "it"), [("true", 0, "the rest"), ("false", 3, "3_forearms_raised")])
def test_one_pose_under_two_names_is_refused(copy, refused, strict, of, it):
    shutil.copy(copy / f"tr_reg_00{of}.ply", copy / "tr_reg_006.ply")
    out, command = arguments(copy)
    message = f"subject 0: {it}{' pose' * (of == 0)} and 6_arms_forward have equal vertices, so they are one"
    refused([*command, "subjects=[0]", f"strict={strict}"], message)
    assert not out.exists()

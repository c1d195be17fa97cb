"""The source FAUST: layouts, poses and landmarks, refused files, and a build."""

import pickle
import shutil
from dataclasses import replace

import numpy as np
import pytest

from defaust.build.dataset import build
from defaust.cli import main
from defaust.folder.layout import sha256
from defaust.tasks import list_tasks, load_task
from sshade import InputError
from sshade.files.meshes import write_mesh
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


@pytest.mark.parametrize("inside", ["", "MPI-FAUST/training/registrations"])
def test_any_folder_around_the_files_is_accepted(folder, inside):
    source = faust(folder.parents[2] / inside)
    np.testing.assert_array_equal(source.rest(0).V, BODIES.rest(0).V)
    for pose, expected in zip(source.poses(3)[:3], BODIES.poses(3), strict=False):
        np.testing.assert_array_equal(source.posed(3, pose).V, BODIES.posed(3, expected).V)


def test_formats_and_other_files(tmp_path, copy):
    source = faust(write_faust(tmp_path / "off", suffix=".off"))
    assert np.abs(source.rest(0).V - BODIES.rest(0).V).max() <= 1e-15 * source.rest(0).diagonal
    assert list(source.checksums([0])) == [f"tr_reg_00{k}.off" for k in POSES]
    ball = icosphere(1)
    write_mesh(copy / "tr_reg_000.obj", ball.V, ball.F)  # .ply takes precedence
    (copy / "tr_reg_1.ply").write_text("not a registration")
    (copy / "tr_reg_036.ply").write_bytes(b"")  # files are read on demand
    source = pickle.loads(pickle.dumps(faust(copy)))
    assert source.rest(0).n == source.posed(3, source.poses(3)[1]).n == 6890
    with pytest.raises(InputError, match=r"tr_reg_036.ply: the file is empty"):
        source.posed(3, source.poses(3)[2])


def test_poses_and_landmarks(folder):
    other = faust(
        folder,
        "source.rest_pose=3", "source.target_poses=[6,0]", "source.unaligned=[0]",
        "source.base_landmarks=[nose,tip]", "source.more_landmarks=[]", "+source.landmarks.tip=7",
    )  # fmt: skip
    assert [(p.name, p.aligned) for p in other.poses(0)] == [("6_arms_forward", True), ("0_standing", False)]
    assert other.landmark_vertices(0) == {"nose": 332, "tip": 7}
    np.testing.assert_array_equal(other.posed(0, other.poses(0)[1]).V, faust(folder).rest(0).V)


def test_missing_files_and_wrong_folders_are_named(folder, tmp_path):
    source = faust(folder)
    assert list(source.checksums([0, 3, 7])) == [
        f"tr_reg_0{k:02d}.ply" for k in (*POSES, *(30 + k for k in POSES[:4]))
    ]
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
    rest = BODIES.rest(0)
    ball = icosphere(2)
    write_mesh(copy / "tr_reg_001.ply", ball.V, ball.F)
    write_mesh(copy / "tr_reg_003.ply", rest.V, rest.F[np.random.default_rng(0).permutation(rest.m)])
    write_mesh(copy / "tr_reg_030.ply", rest.V, np.concatenate([rest.F[:1], rest.F[:-1]]))
    source = faust(copy)
    poses = source.poses(0)
    with pytest.raises(InputError, match="tr_reg_001.ply: 162 vertices and 320 faces, but .* 6890 and 13776"):
        source.posed(0, poses[0])
    with pytest.raises(InputError, match="tr_reg_003.ply: its faces differ from the faces of tr_reg_000"):
        source.posed(0, poses[1])
    with pytest.raises(InputError, match="tr_reg_030.ply: the mesh is not manifold"):
        source.rest(3)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("source.target_poses=[1,10]", "source.target_poses: there is no 10; choose from 0, 1, 2"),
        ("source.target_poses=[0,1]", "source.target_poses holds 0, which is the rest pose"),
        ("source.rest_pose=11", "source.rest_pose: there is no 11; choose from 0"),
        ("source.base_landmarks=[]", "source.base_landmarks is empty; it needs at least one entry"),
        ("source.more_landmarks=[nose]", "'nose' is listed twice"),
        ("source.landmarks.nose=6890", "the vertex of nose is 6890, but the registrations have 6890 vert"),
    ],
)
def test_wrong_options_are_refused(folder, override, message, refused):
    refused(["out=x", "source=faust", f"source.root='{folder}'", override], message)


def test_a_build_lists_its_files_without_paths(copy, tmp_path):
    out = tmp_path / "out"
    options = replace(SMALL, subjects=(0,), target_vertices=None)
    document = build(faust(copy), out, options=options, workers=1)
    names = [f"tr_reg_00{k}.ply" for k in POSES]
    assert document["source"]["files"] == {name: sha256(copy / name) for name in names}
    assert str(tmp_path) not in (out / "dataset.json").read_text()
    tasks = [load_task(out, subject=0, pose=k) for k in range(1, 5)]
    assert [len(set(task.handles.group)) for task in tasks] == [7, 7, 7, 15]
    assert all("poses 1, 3, 6, 8, the rest pose 0 and" in task.meta["note"] for task in tasks)
    with pytest.raises(InputError, match="source.landmark_vertices.nose was 332 and is now 333"):
        build(faust(copy, "source.landmarks.nose=333"), out, options=options, workers=1)
    (copy / "tr_reg_001.ply").write_bytes((copy / "tr_reg_003.ply").read_bytes())
    with pytest.raises(InputError, match="source.files.tr_reg_001.ply was '.*' and is now '"):
        build(faust(copy), out, options=options, workers=1)


def test_a_damaged_copy_is_refused_and_nothing_is_written(copy, tmp_path, refused, caplog):
    """A truncated, a wrong and a missing file, each in a copy; without strict the pose is left out."""
    build_of = ["source=faust", "target_vertices=null", "workers=1"]
    whole = (copy / "tr_reg_001.ply").read_bytes()
    faults = {
        "cut": (lambda path: path.write_bytes(whole[: len(whole) // 2]), "tr_reg_001.ply: "),
        "wrong": (
            lambda path: write_mesh(path, icosphere(2).V, icosphere(2).F),
            "tr_reg_001.ply: 162 vertices",
        ),
        "missing": (lambda path: path.unlink(), "tr_reg_001 is missing"),
    }
    for name, (damage, message) in faults.items():
        root, out = shutil.copytree(copy, tmp_path / name), tmp_path / f"{name}_out"
        damage(root / "tr_reg_001.ply")
        command = [*build_of, f"source.root='{root}'", f"out='{out}'", "subjects=[0]"]
        refused(command, f"subject 0: {message}")
        assert not out.exists()
        caplog.clear()
        assert main(["build", *command, "strict=false"]) == 0
        assert f"left out: subject 0, pose 1: {message}" in caplog.text
        assert list_tasks(out) == [(0, 2), (0, 3), (0, 4)]


def test_one_pose_under_two_names_is_refused(copy, tmp_path, refused):
    shutil.copy(copy / "tr_reg_003.ply", copy / "tr_reg_006.ply")
    out = tmp_path / "out"
    command = [
        "source=faust",
        f"source.root='{copy}'",
        f"out='{out}'",
        "subjects=[0]",
        "target_vertices=null",
    ]
    for strict in ("true", "false"):
        message = "subject 0: 3_forearms_raised and 6_arms_forward have equal vertices, so they are one pose"
        refused([*command, f"strict={strict}"], message)
        assert not out.exists()
    shutil.copy(copy / "tr_reg_000.ply", copy / "tr_reg_006.ply")
    refused(command, "subject 0: the rest pose and 6_arms_forward have equal vertices")

"""Scans: assets, regions and poses, tasks, and the user's armadillo."""

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from defaust.build.verify import verify
from defaust.cli import main
from defaust.folder.record import read_dataset
from defaust.sources import scans
from defaust.sources.scans import NAMES, SCANS, SHIPPED, Scans, identity, shipped
from defaust.sources.winding import same_triangles
from defaust.tasks import list_tasks, load_task
from sshade import Mesh
from sshade.handle_checks import require_rotations
from sshade.io.meshes import read_mesh, write_mesh
from sshade.io.regions import rigidly_moved, vertices_in
from sshade.mesh.adjacency import edge_graph
from tests.shapes import bumpy, torus
from tools.bake.scans import pack

KOALA, CAT, HAND, ARMADILLO = range(4)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The scans of the package; do not change it."""
    out = tmp_path_factory.mktemp("data") / "scans"
    assert main(["build", "source=scans", f"out={out}", "workers=1"]) == 0
    return out


@pytest.fixture
def armadillo(monkeypatch, tmp_path):
    """A folder with armadillo.ply: a copy of the cat, which the armadillo's entry is changed to describe."""
    cat = shipped("cat")
    entry = {k: v for k, v in SCANS["cat"].items() if k != "asset_sha256"} | {"identity": identity(cat)}
    monkeypatch.setitem(scans.SCANS, "armadillo", entry)
    (tmp_path / "mine").mkdir()
    write_mesh(tmp_path / "mine" / "armadillo.ply", 7.0 * cat.V + 1.0, cat.F)
    return tmp_path / "mine"


def regions_of(subject, pose):
    return Scans().poses(subject)[pose].regions


@pytest.mark.parametrize("mesh", [bumpy(3), torus()], ids=["bumpy", "torus"])
def test_packing_renumbers_and_moves_no_coordinate_by_more_than_half_a_step(mesh):
    mesh = Mesh(3.0 * mesh.V - 5.0, mesh.F)
    V, F = scans.unpack(pack(mesh))
    step = np.ptp(mesh.V, axis=0).max() / scans.STEPS
    _, old = cKDTree(mesh.V).query(V)
    assert sorted(old) == list(range(mesh.n))
    assert np.abs(V - mesh.V[old]).max() <= (0.5 + 1e-6) * step
    assert same_triangles(old[F], mesh.F) and Mesh(V, F).volume == pytest.approx(mesh.volume, rel=1e-4)


@pytest.mark.parametrize("subject", [KOALA, CAT, HAND])
def test_every_region_is_one_patch_that_moves_rigidly(subject):
    mesh = Scans().rest(subject)
    graph = edge_graph(mesh).matrix
    scan = SCANS[NAMES[subject]]
    assert len(Scans().poses(subject)) == 3
    for number, pose in enumerate(Scans().poses(subject)):
        told = scan["poses"][pose.name]
        degrees = {name: abs(m["degrees"]) for m in told["moved"] for name in m["regions"]}
        assert sorted(pose.landmarks) == sorted([*told["held"], *degrees]) and degrees
        for region in regions_of(subject, number):
            index = vertices_in(mesh.V, region.boxes)
            assert 100 < len(index) < 0.3 * mesh.n
            assert connected_components(graph[index][:, index], directed=False)[0] == 1
            moved = rigidly_moved(mesh.V[index], region.rotation, region.translation)
            require_rotations(region.rotation[None])
            angle = np.degrees(Rotation.from_matrix(region.rotation).magnitude())
            assert angle == pytest.approx(degrees.get(region.landmark, 0.0), abs=1e-6)
            far = np.linalg.norm(moved - mesh.V[index], axis=1).mean() / mesh.diagonal
            assert (far > 0.05) == (region.landmark in degrees)


def test_a_region_turns_about_its_pivot():
    """The cat's tail, whose pivot stays where it is; y goes to x in a turn by -90 degrees about z."""
    mesh = shipped("cat")
    (tail,) = (region for region in regions_of(CAT, 2) if region.landmark == "tail")
    low, size = mesh.V.min(axis=0), np.ptp(mesh.V, axis=0)
    pivot = low + size * [0.93, 0.62, 0.45]
    moved = rigidly_moved(np.array([pivot, pivot + [0, 1, 0]]), tail.rotation, tail.translation)
    assert np.allclose(moved, [pivot, pivot + [1, 0, 0]], rtol=0, atol=1e-12)


def test_folder(built, capsys):
    assert verify(built) == []
    assert list_tasks(built) == [(s, p) for s in range(3) for p in (1, 2, 3)]
    assert main(["info", str(built)]) == 0
    text = capsys.readouterr().out
    for name in SHIPPED:
        assert SCANS[name]["credit"] in text and f"{name}: {SCANS[name]['licence']}" in text
    assert "armadillo: " not in text


def test_tasks(built):
    for subject, pose in list_tasks(built):
        task = load_task(built, subject=subject, pose=pose)
        assert task.name == f"defaust-scans/subject_0{subject}/pose_{pose}"
        assert task.truth is None and task.meta["no_truth"] == "the pose is known in its regions only"
        for region in regions_of(subject, pose - 1):
            members = task.handles.group == Scans().landmark_names.index(region.landmark)
            assert np.array_equal(task.handles.index[members], vertices_in(task.mesh.V, region.boxes))
        fixed = ~task.handles.dynamic
        assert fixed.any() and task.handles.dynamic.any()
        assert np.array_equal(task.handles.target[fixed], task.mesh.V[task.handles.index[fixed]])


def test_remeshed_scans_keep_their_regions(tmp_path):
    out = tmp_path / "hand"
    small = ["subjects=[2]", "target_vertices=3000", "window=[0.7,1.5]", "workers=1"]
    assert main(["build", "source=scans", f"out={out}", *small]) == 0
    assert verify(out) == []
    high, low = (load_task(out, subject=HAND, pose=2, resolution=name) for name in ("high", "low"))
    assert high.mesh.n < 4500 and low.mesh.n == 7993 and high.truth is None and low.truth is None
    assert set(high.handles.group) == set(low.handles.group)


def test_the_armadillo_is_the_users(armadillo, tmp_path):
    out = tmp_path / "four"
    assert main(["build", "source=scans", f"source.root={armadillo}", f"out={out}", "workers=1"]) == 0
    assert verify(out) == [] and (ARMADILLO, 3) in list_tasks(out)
    theirs, ours = (load_task(out, subject=s, pose=3) for s in (ARMADILLO, CAT))
    # Regions, pivots and shifts scale with the bounding box.
    assert np.array_equal(theirs.handles.index, ours.handles.index)
    assert np.allclose(theirs.handles.target, 7.0 * ours.handles.target + 1.0, rtol=0, atol=1e-11)
    assert Scans(str(armadillo)).checksums((CAT, ARMADILLO)).keys() == {"armadillo.ply"}
    assert "Read from one file; `dataset.json`" in (out / "README.md").read_text()


def test_the_armadillos_own_entry_is_complete():
    entry = SCANS["armadillo"]
    for pose in entry["poses"].values():
        moved = [name for move in pose["moved"] for name in move["regions"]]
        assert set(pose["held"]) | set(moved) <= set(entry["regions"]) and not set(pose["held"]) & set(moved)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: (bumpy(2).V, bumpy(2).F), "has 162 vertices and is not the armadillo with 7,949"),
        (lambda m: (m.V * [-1, 1, -1], m.F), "has 7,949 vertices and is not the armadillo with"),
        (None, "holds no armadillo.ply; without source.root the other scans are built"),
    ],
    ids=["another", "turned", "none"],
)
def test_another_armadillo_is_refused(armadillo, tmp_path, refused, change, message):
    file, out = armadillo / "armadillo.ply", tmp_path / "out"
    mesh = read_mesh(file)
    file.unlink()
    if change:
        write_mesh(file, *change(mesh))
    arguments = ["source=scans", f"source.root={armadillo}", f"out={out}", "workers=1"]
    refused([*arguments, "strict=true"], message)
    assert not out.exists()
    if change:  # the scans of the package are built without it
        assert main(["build", *arguments, "subjects=[1,3]"]) == 0
        document = read_dataset(out)
        assert [one["subject"] for one in document["subjects"]] == [1]
        ((left,),) = (document["left_out"],)
        assert left["subject"] == 3 and message in left["reason"]


def test_a_dataset_of_some_scans_has_the_credits_of_no_other():
    facts = Scans().provenance_of([2])
    assert facts["licence"] == f"hand: {SCANS['hand']['licence']}" and facts["classes"] == list(NAMES)
    told = {name: value for name, value in facts.items() if name != "classes"}
    assert not any(name in str(told) for name in ("koala", "armadillo"))

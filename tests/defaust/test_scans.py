"""Scans: their assets, regions and poses, the user's armadillo, and tasks by fewer handles."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist

from defaust.bake.scans import main as bake
from defaust.build.upsample import self_intersecting
from defaust.build.verify import verify
from defaust.cli import main
from defaust.edits import Unedited
from defaust.sources import packing, scans
from defaust.sources.scans import NAMES, SCANS, SHIPPED, Scans, identity, shipped
from defaust.tasks import list_tasks, load_task
from sshade import InputError, Mesh
from sshade.handles import require_rotations
from sshade.io.handles import read_handles
from sshade.io.meshes import read_mesh, write_mesh
from sshade.io.regions import rigidly_moved, vertices_in
from sshade.mesh.adjacency import edge_graph
from sshade.mesh.rigid import rigid_motion
from tests.shapes import bumpy, torus

KOALA, CAT, HAND, ARMADILLO = range(4)
#: Vertices, faces, volume and area of the published files, and the hash of the packed ones' faces.
PUBLISHED = {
    "koala": (
        49_999,
        99_994,
        57.08943149,
        113.737525,
        "b9f8b6db9ac491db917ecd8d4f7be6834899af80eabbb4a34261027bc14f4d68",
    ),
    "cat": (
        7_949,
        15_894,
        1.9817028019,
        13.19557602,
        "9323ac44978f7dd5855eb948bb1fe5bdff702aaa6a270f8d57770ff73acb629e",
    ),
    "hand": (
        7_993,
        15_982,
        0.0293820649,
        0.8257243897,
        "388f45d79d98943b18fc4c50b5017e3a2bc6d7c3227093a7bb7619f88b8c4f78",
    ),
}
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The scans of the package; do not change it."""
    out = tmp_path_factory.mktemp("data") / "scans"
    assert main(["build", "source=scans", f"out={out}", "workers=1"]) == 0
    return out


@pytest.fixture
def armadillo(monkeypatch, tmp_path):
    """A folder whose armadillo.ply, the cat in truth, is the one that the armadillo's entry speaks of."""
    cat = shipped("cat")
    entry = {k: v for k, v in SCANS["cat"].items() if k != "asset_sha256"} | {"identity": identity(cat)}
    monkeypatch.setitem(scans.SCANS, "armadillo", entry)
    (tmp_path / "mine").mkdir()
    write_mesh(tmp_path / "mine" / "armadillo.ply", 7.0 * cat.V + 1.0, cat.F)
    return tmp_path / "mine"


def regions_of(subject, pose):
    return Scans().poses(subject)[pose].regions


@pytest.mark.parametrize("name", SHIPPED)
def test_assets_hold_the_published_meshes(name):
    mesh = shipped(name)
    vertices, faces, volume, area, pin = PUBLISHED[name]
    assert (mesh.n, mesh.m) == (vertices, faces)
    assert mesh.volume == pytest.approx(volume, rel=2e-6) and mesh.area == pytest.approx(area, rel=2e-5)
    assert mesh.topology == (2, 1, 0) and mesh.is_oriented and mesh.is_closed
    mesh.require_manifold()
    assert not self_intersecting(mesh).any()
    assert identity(mesh)["faces_sha256"] == pin


def test_a_damaged_asset_is_refused(monkeypatch):
    monkeypatch.setitem(scans.SCANS, "cat", {**SCANS["cat"], "asset_sha256": "0" * 64})
    shipped.cache_clear()
    try:
        with pytest.raises(InputError, match="cat.npz is damaged: its sha256 is 2f76.*reinstall the package"):
            shipped("cat")
    finally:
        shipped.cache_clear()


@pytest.mark.parametrize("mesh", [bumpy(3), torus()], ids=["bumpy", "torus"])
def test_packing_renumbers_and_moves_no_coordinate_by_more_than_half_a_step(mesh):
    mesh = Mesh(3.0 * mesh.V - 5.0, mesh.F)
    V, F = packing.unpack(packing.pack(mesh))
    step = np.ptp(mesh.V, axis=0).max() / packing.STEPS
    _, old = cKDTree(mesh.V).query(V)
    assert sorted(old) == list(range(mesh.n))
    assert np.abs(V - mesh.V[old]).max() <= (0.5 + 1e-6) * step

    def faces(F):  # as sets of faces with their winding
        turned = np.take_along_axis(F, (F.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1)
        return set(map(tuple, turned.tolist()))

    assert faces(old[F]) == faces(mesh.F) and len(F) == mesh.m


def test_baking_again_gives_the_assets(tmp_path, monkeypatch):
    """From the meshes that the assets hold: rounding is idempotent, and so is the numbering of the faces."""
    (tmp_path / "out").mkdir()
    for name in SHIPPED:
        mesh = shipped(name)
        write_mesh(tmp_path / f"{name}.ply", mesh.V, mesh.F)
    assert bake(["--meshes", str(tmp_path), "--out", str(tmp_path / "out")]) == 0
    for name in SHIPPED:
        with np.load(tmp_path / "out" / f"{name}.npz") as arrays:
            again = Mesh(*packing.unpack(arrays))
        assert again.n == shipped(name).n and again.volume == pytest.approx(shipped(name).volume, rel=1e-9)


@pytest.mark.parametrize("subject", [KOALA, CAT, HAND])
def test_every_region_is_one_patch_that_moves_rigidly(subject):
    mesh = Scans().rest(subject)
    graph = edge_graph(mesh).matrix
    scan = SCANS[NAMES[subject]]
    rng = np.random.default_rng(0)
    assert len(Scans().poses(subject)) == 3
    for number, pose in enumerate(Scans().poses(subject)):
        taken = np.zeros(mesh.n, dtype=bool)
        told = scan["poses"][pose.name]
        degrees = {name: abs(m["degrees"]) for m in told["moved"] for name in m["regions"]}
        assert sorted(pose.landmarks) == sorted([*told["held"], *degrees]) and degrees
        for region in regions_of(subject, number):
            index = vertices_in(mesh.V, region.boxes)
            assert not taken[index].any() and 100 < len(index) < 0.3 * mesh.n
            taken[index] = True
            assert connected_components(graph[index][:, index], directed=False)[0] == 1
            some = rng.choice(index, size=60, replace=False)
            moved = rigidly_moved(mesh.V[some], region.rotation, region.translation)
            assert np.allclose(pdist(moved), pdist(mesh.V[some]), rtol=0, atol=1e-12 * mesh.diagonal)
            require_rotations(region.rotation[None])
            angle = np.degrees(np.arccos(np.clip((np.trace(region.rotation) - 1) / 2, -1, 1)))
            assert angle == pytest.approx(degrees.get(region.landmark, 0.0), abs=1e-6)
            far = np.linalg.norm(moved - mesh.V[some], axis=1).mean() / mesh.diagonal
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
    assert "No true pose is known" in text and "of which a pose has some: head" in text
    assert "armadillo: " not in text and "LS3 Loop" not in text


def test_tasks(built):
    for subject, pose in list_tasks(built):
        task = load_task(built, subject=subject, pose=pose)
        assert task.name == f"defaust-scans/subject_0{subject}/pose_{pose}"
        assert task.truth is None and task.meta["no_truth"] == "the pose is known in its regions only"
        number = Scans().landmark_names.index
        regions = sorted(regions_of(subject, pose - 1), key=lambda region: number(region.landmark))
        inside = [vertices_in(task.mesh.V, region.boxes) for region in regions]
        assert np.array_equal(task.handles.index, np.concatenate(inside))
        ids = [number(region.landmark) for region in regions]
        assert np.array_equal(task.handles.group, np.repeat(ids, [len(i) for i in inside]))
        held = ~task.handles.dynamic
        assert held.any() and task.handles.dynamic.any()
        assert np.array_equal(task.handles.target[held], task.mesh.V[task.handles.index[held]])
        read = read_handles(built / f"subject_0{subject}/pose_{pose}.json", task.mesh)
        for field in ("index", "target", "dynamic", "group"):
            assert np.array_equal(getattr(read, field), getattr(task.handles, field))


@pytest.mark.parametrize(("choice", "count"), [("landmarks", 6), ("points", 1)])
def test_fewer_handles_of_each_region_keep_their_targets(built, choice, count):
    for subject, pose in list_tasks(built):
        every = load_task(built, subject=subject, pose=pose)
        few = load_task(built, subject=subject, pose=pose, handles=choice)
        assert few.name == f"{every.name}/{choice}" and few.meta["handles"] == choice
        assert every.meta["handles"] == "stored" and few.meta["n_dynamic"] == few.handles.dynamic.sum()
        groups, counts = np.unique(few.handles.group, return_counts=True)
        assert np.array_equal(groups, np.unique(every.handles.group)) and (counts == count).all()
        place = {int(v): k for k, v in enumerate(every.handles.index)}
        at = [place[int(v)] for v in few.handles.index]
        for field in ("target", "group", "dynamic"):
            assert np.array_equal(getattr(few.handles, field), getattr(every.handles, field)[at])
        V = every.mesh.V
        for group in groups:
            own = few.handles.index[few.handles.group == group]
            whole = every.handles.index[every.handles.group == group]
            assert whole[np.linalg.norm(V[whole] - V.mean(axis=0), axis=1).argmax()] in own
            if count > 1:
                R, t = rigid_motion(V[own], few.handles.target[few.handles.group == group])
                assert np.allclose(V[own] @ R.T + t, few.handles.target[few.handles.group == group])


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
    # Regions, pivots and shifts go with the bounding box, in whatever unit.
    assert np.array_equal(theirs.handles.index, ours.handles.index)
    assert np.allclose(theirs.handles.target, 7.0 * ours.handles.target + 1.0, rtol=0, atol=1e-11)
    assert Scans(str(armadillo)).checksums((CAT, ARMADILLO)).keys() == {"armadillo.ply"}
    assert "Read from one file, whose" in (out / "README.md").read_text()


def test_the_armadillos_own_entry_is_complete():
    entry = SCANS["armadillo"]
    assert "armadillo" not in SHIPPED and entry["identity"]["vertices"] == 49_990
    assert len(entry["identity"]["faces_sha256"]) == 64 and len(entry["identity"]["extremes"]) == 6
    for pose in entry["poses"].values():
        moved = [name for move in pose["moved"] for name in move["regions"]]
        assert set(pose["held"]) | set(moved) <= set(entry["regions"]) and not set(pose["held"]) & set(moved)


@pytest.mark.parametrize("change", ["another", "turned", "renumbered", "unreadable", "none", "no folder"])
def test_what_is_no_armadillo_is_refused_in_one_sentence(armadillo, tmp_path, capsys, change):
    file = armadillo / "armadillo.ply"
    mesh = read_mesh(file)
    message = "is another mesh, of 7,949 vertices, than the armadillo of 7,949 in https://github.com"
    if change == "another":
        write_mesh(file, bumpy(2).V, bumpy(2).F)
        message = "is another mesh, of 162 vertices, than the armadillo of 7,949"
    elif change == "turned":
        write_mesh(file, mesh.V * [-1, 1, -1], mesh.F)
    elif change == "renumbered":
        write_mesh(file, mesh.V[::-1], mesh.n - 1 - mesh.F)
    elif change == "unreadable":
        file.write_bytes(file.read_bytes()[:300])
        message = "armadillo.ply"
    elif change == "none":
        file.unlink()
        message = "holds no armadillo.ply; without source.root the other scans are built"
    else:
        shutil.rmtree(armadillo)
        message = "no such folder; set source.root to the folder that holds armadillo.ply"
    out = tmp_path / "out"
    assert main(["build", "source=scans", f"source.root={armadillo}", f"out={out}", "workers=1"]) == 2
    error = capsys.readouterr().err
    assert message in error and error.startswith("error: ") and error.count("\n") == 1
    assert not out.exists()


def test_what_else_is_refused(built):
    with pytest.raises(InputError, match="handles=few is unknown; use one of stored, points, landmarks"):
        load_task(built, subject=CAT, pose=1, handles="few")
    with pytest.raises(InputError, match="pose_1 has no registered pose to transfer"):
        load_task(built, subject=CAT, pose=1, edit=Unedited())
    with pytest.raises(InputError, match=r"there is no subject 3; they are \[0, 1, 2\]"):
        Scans().rest(ARMADILLO)


def test_notice_names_each_asset_its_author_licence_and_changes():
    notice = (ROOT / "NOTICE").read_text(encoding="utf-8")
    for name in SHIPPED:
        entry = SCANS[name]
        author, _, link = entry["credit"].rpartition(", ")
        assert f"defaust/data/{name}.npz" in notice and author in notice and link in notice
        label, _, terms = entry["licence"].partition(" (")
        assert label in notice and terms.rstrip(")") in notice
    assert "armadillo" not in notice and "65535" in notice

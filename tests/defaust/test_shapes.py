"""Generated shapes: meshes at any size, regions, true poses, tasks."""

import shutil

import igl
import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from defaust.build.upsample import self_intersecting
from defaust.build.verify import verify
from defaust.cli import main
from defaust.edits import Unedited
from defaust.sources.generated import cactus
from defaust.sources.generated.shapes import BENT, SHAPES, TWISTED, Shapes
from defaust.tasks import load_task
from sshade import InputError, Mesh
from sshade.files.meshes import read_mesh
from sshade.problem.snapping import vertices_in
from tests.defaust.toy import change, change_handles

PLANE, CYLINDER, BAR, CACTUS = range(4)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """All four at 2,000 vertices; do not change it."""
    out = tmp_path_factory.mktemp("data") / "shapes"
    assert main(["build", "source=shapes", f"out={out}", "target_vertices=2000", "workers=1"]) == 0
    return out


@pytest.mark.parametrize("subject", range(4))
@pytest.mark.parametrize("vertices", [1000, 1777])
def test_meshes_are_near_the_size_asked_for_and_well_shaped(subject, vertices):
    mesh = Shapes().generated(subject, vertices=vertices)
    assert abs(mesh.n - vertices) <= 0.05 * vertices
    assert mesh.is_manifold and mesh.is_oriented
    if subject == PLANE:
        assert mesh.topology == (1, 1, 1) and (mesh.face_normals[:, 2] > 0).all()
    else:
        assert mesh.topology == (2, 1, 0) and mesh.volume > 0
    assert np.degrees(igl.internal_angles(mesh.V, mesh.F).min()) > (8 if subject == CACTUS else 25)
    assert not self_intersecting(mesh).any()


def test_the_cactus_lies_on_its_surface_at_any_size(monkeypatch):
    base = Mesh(*cactus.cactus(1250))
    whole, together = cactus._union, []
    monkeypatch.setattr(cactus, "LATTICE", 3000)
    monkeypatch.setattr(cactus, "BLOCK", 4000)
    monkeypatch.setattr(cactus, "_union", lambda points: together.append(len(points)) or whole(points))
    mesh = Mesh(*cactus.cactus(20_000))
    assert mesh.n == 16 * (base.n - 2) + 2 and mesh.topology == base.topology  # twice subdivided, closed
    assert np.abs(cactus.union(mesh.V)[0]).max() < 10.0**-cactus.DECIMALS and max(together) == 4000
    # Far from the seams it is the capsule: the trunk's top at 6.7, its radius 0.7.
    assert mesh.V[:, 2].max() == pytest.approx(6.7, abs=0.01)


@pytest.mark.parametrize("shape", [SHAPES[CYLINDER], SHAPES[BAR]], ids=["cylinder", "bar"])
def test_true_poses_meet_the_regions_and_are_rigid_there(shape):
    V = Shapes().generated(SHAPES.index(shape), vertices=5000).V
    posed, moved = shape.true_pose(V), shape.motion(V)
    assert np.abs(posed - moved).max() < 1e-14 * 20
    fixed, end = (vertices_in(V, region.boxes) for region in shape.regions)
    assert np.array_equal(posed[fixed], V[fixed])
    R, t = shape.motion.end
    assert np.allclose(posed[end], V[end] @ R.T + t, rtol=0, atol=1e-13)
    assert Rotation.from_matrix(R).magnitude() == pytest.approx(np.radians(shape.motion.degrees), abs=1e-12)


def test_the_bent_cylinders_axis_is_an_arc_of_its_length_and_sections_keep_their_shape():
    z = np.linspace(*(BENT.low, BENT.high), 2001)
    axis = BENT(np.column_stack([0 * z, 0 * z, z]))
    radius = (BENT.high - BENT.low) / np.radians(120.0)
    assert np.allclose(np.linalg.norm(axis - [radius, 0, BENT.low], axis=1), radius, rtol=1e-14)
    assert np.linalg.norm(np.diff(axis, axis=0), axis=1).sum() == pytest.approx(9.0, rel=1e-6)
    disc = np.random.default_rng(0).normal(size=(20, 3)) * [1, 1, 0] + [0, 0, 5.0]
    now, before = (np.linalg.norm(X[1:] - X[0], axis=1) for X in (BENT(disc), disc))
    assert np.allclose(now, before, rtol=1e-13)


def test_the_bar_is_twisted_uniformly():
    corner = np.column_stack([np.full((7, 2), 0.5), np.linspace(TWISTED.low, TWISTED.high, 7)])
    x, y, z = TWISTED(corner).T
    angle = np.degrees(np.unwrap(np.arctan2(y, x)))
    assert np.allclose(np.diff(angle), 135.0 / 6, rtol=1e-12) and np.array_equal(z, corner[:, 2])


@pytest.mark.parametrize("resolution", ["high", "low"])
def test_handles_of_a_task_are_its_regions(built, resolution):
    assert verify(built) == []
    assert "Subjects: 0 plane, 1 cylinder, 2 bar, 3 cactus." in (built / "README.md").read_text()
    for subject, shape in enumerate(SHAPES):
        task = load_task(built, subject=subject, pose=1, resolution=resolution)
        assert (task.truth is not None) == shape.is_known == (task.meta.get("posed_by") == "formulas")
        assert ("no_truth" in task.meta) != shape.is_known
        V, handles = task.mesh.V, task.handles
        for group, region in enumerate(shape.regions):
            assert np.array_equal(handles.index[handles.group == group], vertices_in(V, region.boxes))
        assert np.array_equal(handles.dynamic, handles.group == 1)
        fixed = handles.index[handles.group == 0]
        assert np.array_equal(handles.target[handles.group == 0], V[fixed])
        if shape.is_known:
            assert np.array_equal(task.truth[handles.index], handles.target)


def test_regions_that_share_a_vertex_of_the_full_size_mesh_alone_are_a_fault(built, tmp_path):
    dataset, name = shutil.copytree(built, tmp_path / "shapes"), "subject_02/pose_1.json"
    low, high = (read_mesh(dataset / f"subject_02/{file}") for file in ("rest_low.ply", "rest.ply"))
    place = high.V[cKDTree(low.V).query(high.V)[0].argmax()]
    box = [(place - 1e-6).tolist(), (place + 1e-6).tolist()]
    change_handles(dataset, name, lambda content: [h["boxes"].append(box) for h in content["handles"][:2]])
    (fault,) = verify(dataset)
    assert fault.file == name and fault.text.endswith("a vertex is a handle twice")


def test_what_is_refused(built, tmp_path):
    dataset = shutil.copytree(built, tmp_path / "shapes")
    with pytest.raises(InputError, match="has no registered pose to transfer"):
        load_task(dataset, subject=BAR, pose=1, edit=Unedited())
    change(dataset, lambda d: d["source"]["formulas"].update(bar="another"))
    with pytest.raises(InputError, match="generates the dataset's shapes by other formulas; build it again"):
        load_task(dataset, subject=CYLINDER, pose=1)

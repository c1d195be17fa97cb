"""Generated shapes: meshes at any size, regions, true poses, tasks."""

import shutil

import igl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defaust.build.dataset import build
from defaust.build.options import BuildOptions
from defaust.build.upsample import self_intersecting
from defaust.build.verify import verify
from defaust.cli import main
from defaust.edits import Unedited
from defaust.sources.generated import cactus
from defaust.sources.generated.shapes import BENT, SHAPES, TWISTED, Shapes
from defaust.tasks import load_task
from sshade import InputError, Mesh
from sshade.problem.snapping import vertices_in
from tests.defaust.toy import change, change_handles
from tests.files import contents

PLANE, CYLINDER, BAR, CACTUS = range(4)
SIZES = (1000, 1777, 5000, 40_000)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """All four at 2,000 vertices; do not change it."""
    out = tmp_path_factory.mktemp("data") / "shapes"
    assert main(["build", "source=shapes", f"out={out}", "target_vertices=2000", "workers=1"]) == 0
    return out


@pytest.fixture
def dataset(built, tmp_path):
    """A copy to damage."""
    return shutil.copytree(built, tmp_path / "shapes")


@pytest.mark.parametrize("subject", range(4))
@pytest.mark.parametrize("vertices", SIZES)
def test_meshes_are_near_the_size_asked_for_and_well_shaped(subject, vertices):
    mesh = Shapes().generated(subject, vertices=vertices)
    assert abs(mesh.n - vertices) <= 0.05 * vertices
    mesh.require_manifold()
    mesh.require_one_component()
    assert mesh.is_oriented
    if subject == PLANE:
        assert mesh.topology == (1, 1, 1) and (mesh.face_normals[:, 2] > 0).all()
    else:
        assert mesh.topology == (2, 1, 0) and mesh.volume > 0
    assert np.degrees(igl.internal_angles(mesh.V, mesh.F).min()) > (8 if subject == CACTUS else 25)
    assert not self_intersecting(mesh).any()


def test_the_cactus_lies_on_its_surface_and_its_gradient_is_right():
    rng = np.random.default_rng(0)
    points = rng.uniform([-2.5, -1, -1], [2.5, 1, 7], size=(500, 3))
    value, gradient = cactus.union(points)
    step = 1e-6
    for c in range(3):
        ahead, behind = (cactus.union(points + s * step * np.eye(3)[c])[0] for s in (1, -1))
        assert np.abs((ahead - behind) / (2 * step) - gradient[:, c]).max() < 1e-7
    mesh = Shapes().generated(CACTUS, vertices=3000)
    assert np.abs(cactus.union(mesh.V)[0]).max() < 1e-9
    # Far from the seams it is the capsule: the trunk's top at 6.7, its radius 0.7.
    assert mesh.V[:, 2].max() == pytest.approx(6.7, abs=0.01)
    assert value.min() < 0 < value.max()


def test_a_large_cactus_is_a_subdivided_one_on_the_same_surface(monkeypatch):
    monkeypatch.setattr(cactus, "LATTICE", 3000)
    mesh = Mesh(*cactus.cactus(20_000))
    base = Mesh(*cactus.cactus(1250))
    assert mesh.n == 16 * (base.n - 2) + 2  # twice subdivided, closed
    assert np.abs(cactus.union(mesh.V)[0]).max() < 1e-9 and mesh.topology == base.topology


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
    bent = BENT(disc)
    now, before = (np.linalg.norm(X[1:] - X[0], axis=1) for X in (bent, disc))
    assert np.allclose(now, before, rtol=1e-13)
    # The axis runs through the centres of the sections, so the volume stays (Pappus).
    mesh = Shapes().generated(CYLINDER, vertices=40_000)
    assert Mesh(BENT(mesh.V), mesh.F).volume == pytest.approx(mesh.volume, rel=1e-4)


def test_the_bar_is_twisted_uniformly_and_keeps_its_volume():
    corner = np.column_stack([np.full((7, 2), 0.5), np.linspace(TWISTED.low, TWISTED.high, 7)])
    x, y, z = TWISTED(corner).T
    angle = np.degrees(np.unwrap(np.arctan2(y, x)))
    assert np.allclose(np.diff(angle), 135.0 / 6, rtol=1e-12) and np.array_equal(z, corner[:, 2])
    mesh = Shapes().generated(BAR, vertices=40_000)
    assert Mesh(TWISTED(mesh.V), mesh.F).volume == pytest.approx(4.0, rel=1e-3)


def test_folder(built, capsys):
    names = {"rest.ply", "rest_low.ply", "pose_1.json"}
    expected = {f"subject_0{s}/{name}" for s in range(4) for name in names}
    expected |= {f"subject_0{s}/pose_1_low.ply" for s in (CYLINDER, BAR)}
    assert set(contents(built)) == expected | {"dataset.json", "README.md"}
    assert verify(built) == []
    assert main(["info", str(built)]) == 0
    assert "Subjects: 0 plane, 1 cylinder, 2 bar, 3 cactus." in capsys.readouterr().out


@pytest.mark.parametrize("resolution", ["high", "low"])
def test_tasks(built, resolution):
    for subject, shape in enumerate(SHAPES):
        task = load_task(built, subject=subject, pose=1, resolution=resolution)
        assert task.name == f"defaust-shapes/subject_0{subject}/pose_1"
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


@pytest.mark.parametrize(
    ("subject", "edit", "message"),
    [
        (BAR, lambda h: h[1].update(boxes=[[[5, 5, 5], [6, 6, 6]]]), "moved: no vertex lies in its boxes"),
        (BAR, lambda h: h[1].update(boxes=h[0]["boxes"]), "moved: a vertex is a handle twice"),
        (BAR, lambda h: h[1]["translation"].__setitem__(2, 1.0), "a target is not its vertex"),
        (BAR, lambda h: h[0].update(boxes=[[[0, 0], [1, 1, 1]]]), "handles[0]"),
        (PLANE, lambda h: h[1]["translation"].__setitem__(2, 9.0), "delta is"),
    ],
)
def test_verify_finds_a_wrong_region(dataset, subject, edit, message):
    name = f"subject_0{subject}/pose_1.json"
    change_handles(dataset, name, lambda content: edit(content["handles"]))
    (fault,) = verify(dataset)
    assert fault.file == name and message in fault.text


def test_what_is_refused(dataset, tmp_path):
    with pytest.raises(InputError, match="has no registered pose to transfer"):
        load_task(dataset, subject=BAR, pose=1, edit=Unedited())
    few, missed = BuildOptions(target_vertices=999), BuildOptions(target_vertices=1777, window=(0.999, 1.001))
    with pytest.raises(InputError, match="subject 0: generated shapes have 1000 vertices or more, not 999"):
        build(Shapes(), tmp_path / "x", options=few, workers=1)
    with pytest.raises(InputError, match="generated for 1777 vertices has 1764, not 0.999 to"):
        build(Shapes(), tmp_path / "x", options=missed, workers=1, strict=True)
    change(dataset, lambda d: d["source"]["formulas"].update(bar="another"))
    with pytest.raises(InputError, match="generates the dataset's shapes by other formulas; build it again"):
        load_task(dataset, subject=CYLINDER, pose=1)

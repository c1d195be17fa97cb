"""Handle files of Implicit-ARAP: named parts in other coordinates, registered to the mesh."""

from pathlib import Path

import numpy as np
import pytest

from sshade import InputError, Mesh
from sshade.files.task_files import read_handles
from tests.shapes import bumpy, rotation

BODY = bumpy(3)
#: A mesh with another unit of length, far from the origin.
FAR = Mesh(170 * BODY.V + [300, -50, 20], BODY.F)
AXES = [
    np.eye(3),
    np.diag([-1.0, 1, -1]),
    np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]),
]
POSE = """
handles:
  static:
    positions: [foot, heel]
  moving:
    positions: [hand]
    transform: [hand_up]
"""


class Experiment:
    """A folder of Implicit-ARAP. Its coordinates have other axes, are centred and are scaled to 0.8."""

    def __init__(self, folder: Path, mesh: Mesh, axes: np.ndarray, *, noise: float = 0.0) -> None:
        self.folder, self.axes = folder, axes
        self.centre = np.average(mesh.V[mesh.F].mean(axis=1), axis=0, weights=mesh.face_areas)
        self.scale = 0.8 / np.abs(mesh.V - self.centre).max()
        for name in ("parts", "transforms"):
            (folder / name).mkdir(parents=True)
        order, rng = np.argsort(mesh.V @ [0.2, 0.3, 1.0]), np.random.default_rng(0)
        self.ids = {"foot": order[:20], "heel": order[100:110], "hand": order[-25:]}
        for name, vertices in self.ids.items():
            points = self.to_file(mesh.V[vertices])
            noisy = points + rng.normal(scale=noise, size=points.shape)
            self.put("parts", name, noisy)
        self.put("transforms", "hand_up", noisy @ rotation(1).T + [0.1, 0.2, 0.3])
        self.moved = (points @ rotation(1).T + [0.1, 0.2, 0.3]) @ axes / self.scale + self.centre
        self.path = folder / "pose.yaml"
        self.path.write_text(POSE)

    def to_file(self, V: np.ndarray) -> np.ndarray:
        return ((V - self.centre) * self.scale) @ self.axes.T

    def put(self, kind: str, name: str, points: np.ndarray) -> None:
        np.savetxt(self.folder / kind / f"{name}.txt", points, fmt="%.17g")


@pytest.mark.parametrize("axes", AXES, ids=["same", "flipped", "cycled", "turned"])
@pytest.mark.parametrize("raw", [False, True])
def test_implicit_arap_targets_come_back_in_the_coordinates_of_the_mesh(tmp_path, axes, raw):
    experiment = Experiment(tmp_path / "x", FAR, axes)
    handles = read_handles(experiment.path, FAR, raw=raw)
    order = np.argsort(handles.index)
    expected = FAR.V.copy()
    expected[experiment.ids["hand"]] = experiment.moved
    assert np.array_equal(handles.index[order], np.sort(np.concatenate(list(experiment.ids.values()))))
    gap = np.linalg.norm(handles.target - expected[handles.index], axis=1)
    assert gap.max() <= 1e-6 * FAR.diagonal
    assert np.array_equal(np.sort(handles.index[handles.dynamic]), np.sort(experiment.ids["hand"]))
    assert np.unique(handles.group).tolist() == [0, 1, 2]


def test_a_little_rigid_motion_of_another_copy_is_found_by_icp(tmp_path):
    """Another triangulation has another centroid, so all points are off by the same shift."""
    experiment = Experiment(tmp_path / "x", FAR, AXES[3])
    everywhere = np.random.default_rng(0).permutation(FAR.n)[:200]
    shift, up = np.array([0.006, -0.004, 0.005]), np.array([0, 0, 0.5])
    points = experiment.to_file(FAR.V[everywhere]) + shift
    experiment.put("parts", "all", points)
    experiment.put("transforms", "moved", points + up)
    experiment.path.write_text("handles: {moving: {positions: [all], transform: [moved]}}")
    handles = read_handles(experiment.path, FAR, raw=True)
    # Raw targets are the mapped targets of the file. Without ICP, all would be off by the whole shift.
    target = FAR.V + up @ experiment.axes / experiment.scale
    gap = np.linalg.norm(handles.target - target[handles.index], axis=1)
    assert np.max(gap) < 0.75 * np.linalg.norm(shift) / experiment.scale


def _static(part: str) -> str:
    return f"handles: {{static: {{positions: [{part}]}}}}"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("handles: {statc: {positions: [foot]}}", '`handles`: .*"statc"; did you mean .static'),
        ("handles: {static: {position: [foot]}}", '`handles.static`: .*"position"; did you mean .positions'),
        ("handles: {moving: {positions: [hand], transforms: [a]}}", '"transforms"; did you mean .transform'),
        (bytes(range(128, 256)).decode("latin-1"), "not readable as YAML"),
        ("- 1\n- 2\n", "`handles`"),
        (1_000 * "[", "not readable as YAML"),
        ("handles: !!python/object/apply:os.system ['touch hacked']\n", "not readable as YAML"),
        ("handles: {static: {}, moving: {}}", "there are no handles"),
        ("handles: {static: {positions: 3}}", "list of names"),
        (_static("head"), "head.txt"),
        ("handles: {moving: {positions: [hand]}}", "1 moving part has 0 transforms"),
        (_static("words"), "three numbers"),
        (_static("other"), "is this the mesh they were made for?"),
    ],
)
def test_a_wrong_file_of_implicit_arap_is_refused_in_one_sentence(here, content, message):
    experiment = Experiment(here / "x", FAR, AXES[0])
    path = experiment.path
    (path.parent / "parts" / "words.txt").write_text("a b c\n")
    experiment.put("parts", "other", [[0.1, 5, 5], [0.2, 5, 5], [0.1, 6, 5], [0.4, 7, 5]])
    path.write_text(content)
    with pytest.raises(InputError, match=message) as refused:
        read_handles(path, FAR)
    assert "\n" not in str(refused.value) and not list(here.rglob("hacked"))
    path.write_text("mesh: hand.ply\n" + POSE)
    assert len(read_handles(path, FAR))


def test_static_or_moving_parts_may_be_missing(tmp_path):
    path = Experiment(tmp_path / "x", FAR, AXES[0]).path
    path.write_text("handles: {static: {positions: [foot]}}")
    assert not read_handles(path, FAR).dynamic.any()
    path.write_text("handles: {moving: {positions: [hand], transform: [hand_up]}, static: }")
    assert read_handles(path, FAR).dynamic.all()

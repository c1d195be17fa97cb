"""Handle files of Implicit-ARAP: named parts in other coordinates, registered to the mesh."""

from pathlib import Path

import numpy as np
import pytest

from sshade import Mesh, read_handles
from tests.shapes import bumpy, rotation

#: A mesh with another unit of length, far from the origin.
FAR = Mesh(170 * bumpy(3).V + [300, -50, 20], bumpy(3).F)
#: Its coordinates in files of Implicit-ARAP, but for the axes.
CENTRE = np.average(FAR.V[FAR.F].mean(axis=1), axis=0, weights=FAR.face_areas)
SCALE = 0.8 / np.abs(FAR.V - CENTRE).max()
AXES = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
ORDER = np.argsort(FAR.V @ [0.2, 0.3, 1.0])
IDS = {"foot": ORDER[:20], "heel": ORDER[100:110], "hand": ORDER[-25:]}
POSE = """
mesh: hand.ply
handles:
  static: {positions: [foot, heel]}
  moving: {positions: [hand], transform: [up]}
"""


def to_file(V: np.ndarray, axes: np.ndarray) -> np.ndarray:
    return ((V - CENTRE) * SCALE) @ axes.T


def from_file(points: np.ndarray, axes: np.ndarray) -> np.ndarray:
    return points @ axes / SCALE + CENTRE


def put(axes: np.ndarray = AXES, **transforms: np.ndarray) -> None:
    """Write pose.yaml with its parts and transforms."""
    for kind in ("parts", "transforms"):
        Path(kind).mkdir(exist_ok=True)
    parts = {name: to_file(FAR.V[ids], axes) for name, ids in IDS.items()}
    up = parts["hand"] @ rotation(1).T + [0.1, 0.2, 0.3]
    for kind, files in {"parts": parts, "transforms": {"up": up, **transforms}}.items():
        for name, points in files.items():
            np.savetxt(f"{kind}/{name}.txt", points, fmt="%.17g")
    Path("pose.yaml").write_text(POSE)


@pytest.mark.parametrize("axes", [np.eye(3), np.diag([-1.0, 1, -1]), AXES], ids=["same", "flipped", "turned"])
@pytest.mark.parametrize("raw", [False, True])
def test_targets_come_back_in_the_coordinates_of_the_mesh(here, axes, raw):
    put(axes)
    handles = read_handles("pose.yaml", FAR, raw=raw)
    expected, hand = FAR.V.copy(), to_file(FAR.V[IDS["hand"]], axes)
    expected[IDS["hand"]] = from_file(hand @ rotation(1).T + [0.1, 0.2, 0.3], axes)
    np.testing.assert_allclose(handles.target, expected[handles.index], rtol=0, atol=1e-6 * FAR.diagonal)
    groups = [np.sort(handles.index[handles.group == number]) for number in range(3)]
    assert all(map(np.array_equal, groups, map(np.sort, IDS.values())))
    assert np.array_equal(handles.dynamic, handles.group == 2)


def test_a_little_rigid_motion_of_another_copy_is_found_by_icp(here):
    """Another triangulation has another centroid, so all points are off by the same shift."""
    everywhere = np.random.default_rng(0).permutation(FAR.n)[:200]
    shift, up = np.array([0.006, -0.004, 0.005]), np.array([0, 0, 0.5])
    points = to_file(FAR.V[everywhere], AXES) + shift
    put(moved=points + up)
    np.savetxt("parts/all.txt", points)
    Path("pose.yaml").write_text("handles: {moving: {positions: [all], transform: [moved]}, static: }")
    handles = read_handles("pose.yaml", FAR, raw=True)
    # Raw targets are the mapped targets of the file. Without ICP, all would be off by the whole shift.
    gap = np.linalg.norm(handles.target - FAR.V[handles.index] - up @ AXES / SCALE, axis=1)
    assert np.max(gap) < 0.75 * np.linalg.norm(shift) / SCALE

"""Files of DeformingThings4D: their content, the choice of frames, and refused files."""

import pickle
import struct
from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defaust.build.dataset import build
from defaust.build.verify import verify
from defaust.sources.animations import Counts, far_frames, read_counts, read_frame
from defaust.tasks import load_task
from sshade import InputError
from tests.defaust.registrations import configured
from tests.defaust.toy import KEPT
from tests.shapes import icosphere

BALL = icosphere(2)
source_of = partial(configured, "sequence")


def packed(frames, F):
    """The bytes of a file."""
    first = np.asarray(frames[0], dtype=np.float32)
    data = struct.pack("<3i", len(frames), len(first), len(F)) + first.tobytes()
    data += np.asarray(F, dtype=np.int32).tobytes()
    return data + b"".join((np.asarray(frame, dtype=np.float32) - first).tobytes() for frame in frames[1:])


def write(path, frames, F=BALL.F):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(packed(frames, F))
    return path


def sheared(amount):
    return BALL.V + amount * np.maximum(0.0, BALL.V[:, 1:2]) * [1.0, 0, 0]


def walked(V, step):
    """Move and turn a shape as a whole."""
    return V @ Rotation.from_euler("y", 40 * step, degrees=True).as_matrix().T + [3.0 * step, 0, 0]


def test_a_file_is_read_as_it_was_written(tmp_path):
    frames = [sheared(amount) for amount in (0.0, 0.5, -1.25)]
    path = write(tmp_path / "bear.anime", frames)
    assert read_counts(path) == Counts(3, BALL.n, BALL.m)
    for number, expected in enumerate(frames):
        V, F = read_frame(path, number)
        assert V.dtype == np.float64 and F.dtype == np.int64
        np.testing.assert_allclose(V, expected, rtol=0, atol=5e-7)
        np.testing.assert_array_equal(F, BALL.F)
    with pytest.raises(InputError, match="has no frame 3; its frames are 0 to 2"):
        read_frame(path, 3)


def test_poses_are_far_from_each_other_whatever_the_walk(tmp_path):
    """A walk through the scene is not another pose; equal frames are chosen once."""
    amounts = [0.0, 0.1, 0.9, 1.0, 0.9, 0.1, 0.0, -0.2, -1.0, -0.2]
    frames = [walked(sheared(amount), step) for step, amount in enumerate(amounts)]
    path = write(tmp_path / "bear.anime", frames)
    assert far_frames(path, rest=0, count=1) in ([3], [8])
    assert far_frames(path, rest=0, count=2) == [3, 8]
    assert far_frames(path, rest=3, count=1) == [8]
    distinct = far_frames(path, rest=0, count=50)
    assert sorted({round(amounts[k], 6) for k in distinct}) == [-1.0, -0.2, 0.1, 0.9, 1.0]
    still = write(tmp_path / "still.anime", [walked(BALL.V, step) for step in range(5)])
    assert far_frames(still, rest=0, count=3) == []


def test_a_folder_of_animations_is_built(tmp_path, caplog):
    root = tmp_path / "animals"
    amounts = np.sin(np.linspace(0, 2 * np.pi, 9))
    write(root / "bear3EP_Jump/bear3EP_Jump.anime", [sheared(a) for a in amounts])
    write(root / "fox_Run/fox_Run.anime", [walked(sheared(2 * a), 1) for a in amounts])
    (root / "fox_Run/._fox_Run.anime").write_bytes(b"what macOS leaves")
    whole = packed([BALL.V, sheared(1)], BALL.F)
    (root / "cut_off.anime").write_bytes(whole[:-1])
    source = pickle.loads(pickle.dumps(source_of(root, "source.frames=2")))
    assert source.provenance["classes"] == ["bear3EP_Jump", "fox_Run"]
    assert source.provenance["rest_poses"] == ["frame_0", "frame_0"]
    assert [pose.name for pose in source.poses(0)] == ["frame_2", "frame_6"]
    assert any("at most 2 of its frames" in text for text in source.provenance["limits"])
    build(source, tmp_path / "out", options=KEPT, workers=1)
    assert "left out: cut_off: cut_off.anime: has " in caplog.text
    assert verify(tmp_path / "out") == []
    assert str(tmp_path) not in (tmp_path / "out/dataset.json").read_text()
    task = load_task(tmp_path / "out", subject=1, pose=2)
    assert task.meta["posed_by"] == "registration" and task.meta["source_pose"] == "frame_6"
    np.testing.assert_allclose(task.truth, walked(sheared(2 * amounts[6]), 1), rtol=0, atol=1e-6)


def test_frames_may_be_named(tmp_path):
    path = write(tmp_path / "bear.anime", [sheared(a) for a in (0.0, 0.5, 1.0, 0.2)])
    source = source_of(path, "source.rest_pose=frame_2", "source.poses_used=[frame_3,frame_1]")
    assert [pose.name for pose in source.poses(0)] == ["frame_1", "frame_3"]
    np.testing.assert_allclose(source.rest(0).V, sheared(1.0), rtol=0, atol=1e-6)
    assert not any("frames" in text for text in source.provenance["limits"])


def test_an_animation_that_never_moves_is_no_subject(tmp_path):
    write(tmp_path / "still.anime", [BALL.V] * 3)
    write(tmp_path / "moves.anime", [BALL.V, sheared(1)])
    write(tmp_path / "single.anime", [BALL.V])
    source = source_of(tmp_path)
    assert source.provenance["classes"] == ["moves", "still"]
    assert source.provenance["left_out"] == {"single": "it has no target pose besides its rest pose"}
    with pytest.raises(InputError, match="the class still has no target pose besides its rest pose frame_0"):
        source.poses(1)


def test_cut_files_are_refused(tmp_path):
    data = packed([BALL.V[:4], 2 * BALL.V[:4], 3 * BALL.V[:4]], [[0, 1, 2], [0, 2, 3]])
    path = tmp_path / "bear.anime"
    for length in range(len(data)):
        path.write_bytes(data[:length])
        with pytest.raises(InputError, match="bear.anime: ") as caught:
            read_frame(path, 0)
        assert "\n" not in str(caught.value)
    path.write_bytes(struct.pack("<i", 2**31 - 1) + data[4:])
    with pytest.raises(InputError, match="but 2,147,483,647 frames of 4 vertices"):
        read_counts(path)
    path.write_bytes(struct.pack("<i", -2) + data[4:])
    with pytest.raises(InputError, match="it would have -2 frames"):
        read_counts(path)
    path.write_bytes(data + b"\0")
    with pytest.raises(InputError, match="it is cut off, or not a .anime file"):
        read_frame(path, 0)


@pytest.mark.parametrize("frame", [0, 2])
def test_positions_that_are_not_finite_are_refused(tmp_path, frame):
    frames = [sheared(a) for a in (0.0, 0.5, 1.0)]
    path = write(tmp_path / "bear.anime", frames)
    data = bytearray(path.read_bytes())
    start = 12 + 12 * BALL.n * frame + (12 * BALL.m if frame else 0)
    data[start : start + 4] = struct.pack("<f", np.nan)
    path.write_bytes(data)
    with pytest.raises(InputError, match=f"^bear.anime: frame {frame} has a NaN or infinite position"):
        source_of(path).poses(0)


def test_two_files_of_one_name_are_refused(tmp_path):
    for folder in ("a", "b"):
        write(tmp_path / folder / "bear.anime", [BALL.V, sheared(1)])
    with pytest.raises(InputError, match="another file is called bear.anime"):
        source_of(tmp_path)

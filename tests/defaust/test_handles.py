"""Choice of handles, displacements, and the entries of pose files."""

import numpy as np
import pytest

from defaust.build.handles import choose_handles, displacement, nearest_vertices
from defaust.build.options import BuildOptions
from defaust.sources.synthetic import SyntheticBodies
from sshade import InputError
from tests.shapes import jittered, strip


@pytest.fixture(scope="module")
def sheet():
    """A square of 12 x 12 vertices with irrational edge lengths."""
    return jittered(strip(11, 11), 0.1)


def test_handles_are_near_distinct_and_reproducible():
    source = SyntheticBodies()
    rest = source.rest(1)
    landmarks = source.landmark_vertices(1)
    chosen = choose_handles(rest, landmarks, subject=1, options=BuildOptions())
    everything = np.concatenate(list(chosen.values()))
    assert len(np.unique(everything)) == len(everything) == 30 * len(landmarks)
    for name, index in chosen.items():
        assert np.isin(index, nearest_vertices(rest, landmarks[name], count=60)).all()
    for subject, seed in ((1, 1), (2, 0)):
        again = choose_handles(rest, landmarks, subject=subject, options=BuildOptions(seed=seed))
        assert not all(np.array_equal(again[name], chosen[name]) for name in chosen)
    with pytest.raises(InputError, match="only 6890 vertices can be reached from vertex 0"):
        nearest_vertices(rest, 0, count=6891)


def test_overlapping_landmarks_share_no_vertex(sheet):
    options = BuildOptions(handles_per_landmark=20, neighbourhood=40)
    chosen = choose_handles(sheet, {"a": 65, "b": 66}, subject=0, options=options)
    assert not set(chosen["a"]) & set(chosen["b"])
    with pytest.raises(InputError, match="'b' has .* left that no other landmark took, and needs 30"):
        choose_handles(sheet, {"a": 65, "b": 65}, subject=0, options=BuildOptions(neighbourhood=40))


def test_delta_by_hand():
    source = np.zeros((3, 3))
    target = np.array([[3.0, 4.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    d = displacement(source, target, diagonal=39.0, static_below=0.05)
    assert d == {"delta": 6.0, "delta_mean": 2.0, "kind": "dynamic"}  # 2 >= 0.05 * 39 = 1.95
    assert displacement(source, target, diagonal=41.0, static_below=0.05)["kind"] == "static"  # 2 < 2.05
    assert displacement(source, target, diagonal=41.0, static_below=0.04)["kind"] == "dynamic"

"""Choice of handles, displacements, entries of pose files, and measures of a case."""

import numpy as np
import pytest

from defaust.build.handles import choose_handles, displacement, handle_records, nearest_vertices
from defaust.build.measures import case_facts
from defaust.build.options import BuildOptions
from defaust.folder.card import contradiction_texts
from defaust.sources.source import SourcePose
from defaust.sources.synthetic import SyntheticBodies
from sshade import InputError, Mesh
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


def facts_of(posed, *, chosen):
    rest = strip(20, 2)  # a band of 20 x 2 squares
    pose = SourcePose("pose", tuple(chosen))
    mesh = Mesh(posed(rest.V), rest.F)
    records = handle_records(rest, mesh, pose, regions=(), chosen=chosen, options=BuildOptions())
    return rest, case_facts(rest, mesh, records)


def near(x):
    """Vertices of the band whose first coordinate lies around x."""
    return np.flatnonzero(np.abs(strip(20, 2).V[:, 0] - x) <= 1.0)


def rotated(V, degrees, beyond):
    """Rotate the vertices beyond a first coordinate about that place, in the plane of the band."""
    a = np.radians(degrees)
    R = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    centre = np.array([beyond, 0.0, 0.0])
    return np.where(V[:, :1] > beyond, (V - centre) @ R.T + centre, V)


def test_a_rigid_motion_leaves_no_residual_and_no_angle():
    _, facts = facts_of(lambda V: rotated(V, 90, -1) + [3, 0, 0], chosen={"a": near(3), "b": near(15)})
    assert facts["moving"] == len(near(3)) + len(near(15)) and facts["static_moved"] is None
    for group in facts["groups"]:
        assert group["residual"] == pytest.approx(0, abs=1e-12)
        assert group["turned"] == pytest.approx(0, abs=1e-5)


def test_a_bent_landmark_differs_from_its_surroundings():
    # All handles at the end turn by 40 degrees, and less than half of the surface around them does.
    _, facts = facts_of(lambda V: rotated(V, 40, 18.5), chosen={"fixed": near(3), "end": near(20)})
    fixed, end = facts["groups"]
    assert fixed["turned"] == pytest.approx(0, abs=1e-5) and 5 < end["turned"] < 40
    assert facts["static_moved"] == 0.0 and facts["moving"] == len(near(20))


def test_the_residual_is_a_fraction_of_the_extent():
    # Stretch by 1.5 along the band: s - 1.25 s is left at each end of a group that lies on one line.
    _, facts = facts_of(lambda V: V * [1.5, 1, 1], chosen={"line": np.flatnonzero(strip(20, 2).V[:, 1] == 0)})
    assert facts["groups"][0]["residual"] == pytest.approx(0.5)


def test_landmarks_that_disagree_are_listed():
    rest, facts = facts_of(lambda V: V + [0, 0, 4] * (V[:, :1] > 4.5), chosen={"a": near(3), "b": near(6)})
    pair = {"static": "a", "dynamic": "b", "apart": 1 / rest.diagonal, "distance": 4 / rest.diagonal}
    assert facts["contradictions"] == [pytest.approx(pair, abs=1e-6)]
    (said,) = contradiction_texts({"subject": 0, "poses": [facts | {"pose": 1}]})
    assert f"{pair['static']} stays, and the motion of {pair['dynamic']}, which is" in said
    _, far = facts_of(lambda V: V + [0, 0, 4] * (V[:, :1] > 4.5), chosen={"a": near(3), "b": near(15)})
    assert far["contradictions"] == []
    _, turned = facts_of(lambda V: rotated(V, 90, 4.5), chosen={"a": near(3), "b": near(6)})
    away = np.linalg.norm(rest.V[near(3)] - [4.5, 0, 0], axis=1).mean()
    assert turned["contradictions"][0]["distance"] == pytest.approx(np.sqrt(2) * away / rest.diagonal)

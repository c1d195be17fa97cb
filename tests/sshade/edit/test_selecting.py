"""A session without a browser: vertices are picked, and groups are marked and limited."""

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra

from sshade.edit.groups import Motion
from sshade.mesh.adjacency import vertex_graph
from tests.shapes import beside, shifted
from tests.sshade.edit.sessions import BODY, HIGH, LOW, added, begun, settled

pytestmark = pytest.mark.usefixtures("here")


def test_ways_to_pick_are_those_of_sets():
    mesh = beside(BODY, shifted(BODY, [4, 0, 0]))
    session, rng = begun(mesh), np.random.default_rng(0)
    a, b = (set(rng.choice(BODY.n, 90, replace=False).tolist()) for _ in range(2))
    steps = [("replace", a, a), ("add", b, a | b), ("replace", a, a), ("remove", b, a - b)]
    steps += [("invert", (), set(range(mesh.n)) - (a - b)), ("replace", {3, 90}, {3, 90})]
    steps.append(("linked", (), set(range(BODY.n))))  # of two components
    for how, given, expected in steps:
        session.select(np.array(list(given), dtype=np.int64), how)
        assert session.state.selection.tolist() == sorted(expected), how


def test_a_limited_group_moves_nothing_beyond_the_distance():
    session = begun()
    number, other = added(session, HIGH, "moved"), added(session, LOW, "moved")
    before = session.state.group(other)
    number_beyond = session.limit(number, 1.0)
    made = session.state.group(number_beyond)
    own = session.state.group(number).vertices
    along_edges = dijkstra(vertex_graph(BODY).matrix, indices=own, min_only=True)
    near = np.flatnonzero(along_edges <= 1.0)
    assert made.kind == "fixed" and sorted([*made.vertices, *near, *LOW]) == list(range(BODY.n))
    assert session.state.group(other) is before  # other groups keep their vertices
    settled(session, number, Motion(np.eye(3), np.array([0, 0, 0.2])))
    moved = np.linalg.norm(session.shown - BODY.V, axis=1)
    assert moved[made.vertices].max() == 0 and np.allclose(moved[own], 0.2)
    between = np.setdiff1d(near, own)
    assert len(between) and 0.01 < moved[between].mean() < 0.2

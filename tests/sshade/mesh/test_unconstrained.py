"""Components without handles: contacts with other components, advice to the user, and rigid motions."""

import numpy as np
import pytest

from sshade import DeformationTask, Handles, Mesh, deform
from sshade.mesh.unconstrained import contacts, leaders
from tests.shapes import beside, bumpy, rotation, shifted, unjoined

BODY = bumpy(2)


def test_contacts_are_places_of_several_components():
    mesh, free = unjoined(BODY), np.arange(1, BODY.m)
    found = contacts(mesh, free)
    assert found.components == BODY.m - 1 and len(found.vertex) == mesh.n
    assert np.array_equal(np.sort(found.vertex), np.arange(mesh.n))
    assert np.array_equal(mesh.V[found.vertex], mesh.V[found.first])
    assert len(np.unique(found.first)) == BODY.n
    # If only component 7 has no handles, only the contacts of component 7 count.
    few = contacts(mesh, np.array([7]))
    assert few.components == 1
    assert set(few.first) == set(few.vertex[np.unique(few.first, return_index=True)[1]])
    assert len(np.unique(few.first)) == 3 and {21, 22, 23} <= set(few.vertex)
    assert contacts(mesh, np.zeros(0, dtype=int)).components == 0
    apart = beside(BODY, shifted(BODY, 9))
    none = contacts(apart, np.array([1]))
    assert none.components == 0 and none.opening(apart.V) == 0
    V = mesh.V.copy()
    V[30] += [0.3, 0, 0.4]
    assert found.opening(mesh.V) == 0 and found.opening(V) == pytest.approx(0.5)


def test_components_that_come_apart_are_named_before(caplog):
    """The triangles touch at coincident corners, which the task does not merge."""
    mesh, b = unjoined(BODY), np.array([0, 1, 2])
    target = mesh.V[b] @ rotation(1).T
    seen = []
    task = DeformationTask("m", mesh, Handles(b, target))
    result = deform(task, progress=lambda *_: seen.append(len(caplog.records)))
    words = "319 components without handles touch other components, and may come apart from them where"
    assert words in caplog.text and min(seen, default=1) == 1
    assert result.facts.touching == 319 and result.facts.opening < 1e-12  # all follow one triangle
    target[2] += 0.3
    two = Handles(np.append(b, 600), np.concatenate([target, mesh.V[[600]] + 1]))
    result = deform(DeformationTask("m", mesh, two))
    assert result.facts.opening > 0.01


def in_order(mesh: Mesh) -> Mesh:
    """Return the mesh with its vertices numbered along x."""
    order = np.argsort(mesh.V[:, 0])
    return Mesh(mesh.V[order], np.argsort(order)[mesh.F])


@pytest.mark.parametrize("gap", [0.0, 0.05, -0.2])
def test_a_component_follows_the_one_that_it_is_next_to_through_others(gap):
    """The first body is fixed, the last one moves. The third touches the second; its nearest handle moves."""
    body, n = in_order(bumpy(4)), bumpy(4).n
    width = np.ptp(body.V[:, 0]) + gap
    mesh = beside(*(shifted(body, [x * width, 0, 0]) for x in (0.0, 1.0, 2.0, 3.4)))
    index = np.append(np.arange(n), np.arange(3 * n, 4 * n))
    target = mesh.V[index] + np.repeat([[0, 0, 0], [0, 2.0, 0]], n, axis=0)
    shape = deform(DeformationTask("row", mesh, Handles(index, target))).vertices
    np.testing.assert_allclose(shape[: 3 * n], mesh.V[: 3 * n], atol=1e-12)


@pytest.mark.parametrize("x", [1.2, 1.6])
def test_a_component_between_two_others_follows_the_nearer(x):
    """All vertices of the outer bodies are handles: the left one stays, the right one is lifted."""
    width, n = np.ptp(BODY.V[:, 0]), BODY.n
    mesh = beside(*(shifted(BODY, [x * width, 0, 0]) for x in (0.0, x, 2.8)))
    index = np.append(np.arange(n), np.arange(2 * n, 3 * n))
    target = mesh.V[index] + np.repeat([[0, 0, 0], [0, 2.0, 0]], n, axis=0)
    shape = deform(DeformationTask("row", mesh, Handles(index, target))).vertices
    np.testing.assert_allclose((shape - mesh.V)[n : 2 * n], [[0, 2.0 * (x > 1.4), 0]] * n, atol=1e-12)


def test_beads_follow_the_surface_and_not_each_other():
    order = np.argsort(BODY.V[:, 2])[::10]
    beads = [shifted(Mesh(0.04 * BODY.V, BODY.F), place) for place in 1.02 * BODY.V[order]]
    mesh = beside(BODY, *beads)
    led = leaders(mesh, np.arange(1, len(beads) + 1))
    assert sorted(mesh.component[moved[0]] for moved, _ in led) == list(range(1, len(beads) + 1))
    assert {mesh.component[near[0]] for _, near in led} == {0}

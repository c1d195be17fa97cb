"""Components without handles: contacts with other components, advice to the user, and rigid motions."""

import numpy as np
import pytest

from sshade import DeformationTask, Handles, InputError, deform
from sshade.mesh.unconstrained import contacts, how_to_constrain
from tests.shapes import beside, bumpy, jittered, rotation, shifted, unjoined

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


def test_an_opening_is_the_distance_between_vertices_that_touched():
    mesh = beside(BODY, BODY)
    found = contacts(mesh, np.array([1]))
    V = mesh.V.copy()
    V[BODY.n + 5] += [0.3, 0, 0.4]
    assert found.opening(mesh.V) == 0 and found.opening(V) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("noise", "advice"),
    [
        (0.0, "weld the vertices in which 319 of them touch other components (sshade deform --repair, in Py"),
        (3e-7, "(sshade deform --repair --weld 1e-06, in Python repair=True, weld=1e-06), or leave"),
        (1e-4, "give each one, or leave --refuse-unconstrained out (in Python refuse_unconstrained=True)"),
    ],
)
def test_the_advice_fits_the_mesh(noise, advice):
    mesh = jittered(unjoined(BODY), noise * BODY.diagonal)
    assert advice in how_to_constrain(mesh, mesh.components_without(np.array([0, 1])))
    with pytest.raises(InputError) as refused:
        DeformationTask("m", mesh, Handles([0], mesh.V[:1]), refuse_unconstrained=True)
    assert "319 of the mesh's 320 components have no handle" in str(refused.value)
    assert advice in str(refused.value)


def test_what_the_advice_says_helps():
    mesh = jittered(unjoined(BODY), 3e-7 * BODY.diagonal)
    b = np.array([np.argmin(mesh.V[:, 2]), np.argmax(mesh.V[:, 2])])
    moved = deform(mesh, b, mesh.V[b] * 1.1, repair=True, weld=1e-6, vertices=60)
    assert np.abs(moved.V[b] - mesh.V[b] * 1.1).max() < 1e-3


def test_components_that_come_apart_are_named_before(caplog):
    """The triangles touch at coincident corners, which the task does not merge."""
    mesh, b = unjoined(BODY), np.array([0, 1, 2])
    target = mesh.V[b] @ rotation(1).T
    seen = []
    task = DeformationTask("m", mesh, Handles(b, target))
    result = deform(task, progress=lambda *_: seen.append(len(caplog.records)))
    words = "319 components without handles touch other components, and come apart from them where"
    assert words in caplog.text and min(seen, default=1) == 1
    assert result.facts.touching == 319 and result.facts.opening < 1e-12  # all follow one triangle
    target[2] += 0.3
    two = Handles(np.append(b, 600), np.concatenate([target, mesh.V[[600]] + 1]))
    result = deform(DeformationTask("m", mesh, two))
    assert result.facts.opening > 0.01

"""The reduced mesh that a 3D view shows, and its packed form."""

import base64
import gzip

import numpy as np
import pytest

from sshade import Handles, Mesh
from sshade.plotting import pictures
from sshade.plotting import view as module
from sshade.plotting.view import ViewShape, pack, packed_view, surface
from tests.shapes import beside, bumpy, icosphere, shifted


def test_a_small_mesh_is_shown_whole_and_a_large_one_by_samples():
    mesh = bumpy(3)
    whole = surface(mesh, keep=np.array([3]))
    assert np.array_equal(whole.faces, mesh.F) and np.array_equal(whole.samples, np.arange(mesh.n))
    values = np.random.default_rng(0).normal(size=mesh.n)
    assert np.array_equal(whole.mean(values), values)
    keep = np.array([600, 7, 80])
    some = surface(mesh, keep=keep, limit=600, samples=150)
    assert some.samples[:3].tolist() == keep.tolist()
    assert 150 <= len(some.samples) < 170 and some.faces.max() == len(some.samples) - 1
    for k in (0, 2, 100):
        assert some.mean(values)[k] == pytest.approx(values[some.cell == k].mean())
    assert some.mean(np.full(mesh.n, 2.5)) == pytest.approx(2.5)


def test_packed_shapes_come_back_to_their_precision():
    mesh = bumpy(1)
    shapes = [mesh.V, 2 * mesh.V + 1]
    error = np.linspace(0, 12, mesh.n)
    packed = pack(shapes, [None, error], mesh.F, top=10.0)
    assert packed == pack(shapes, [None, error], mesh.F, top=10.0)
    data = gzip.decompress(base64.b64decode(packed["data"]))
    n, m = mesh.n, mesh.m
    assert len(data) == 12 * m + 2 * 6 * n + -(-n // 4) * 4 and n % 2 == 0
    assert np.array_equal(np.frombuffer(data, "<u4", 3 * m).reshape(-1, 3), mesh.F)
    low, span = np.array(packed["low"]), np.array(packed["span"])
    for k, V in enumerate(shapes):
        stored = np.frombuffer(data, "<u2", 3 * n, offset=12 * m + 6 * n * k).reshape(3, n).T
        assert (np.abs(low + span * stored / 65535 - V) <= 0.5001 * span / 65535).all()
    stored = np.frombuffer(data, "u1", n, offset=12 * m + 12 * n).astype(float)
    assert np.abs(10 * stored / 255 - np.minimum(error, 10)).max() <= 0.5001 * 10 / 255


@pytest.mark.parametrize("most", [200, 1])
def test_a_large_mesh_of_several_components_is_shown_by_parts_or_clusters_and_keeps_its_handles(
    most, monkeypatch
):
    monkeypatch.setattr(module, "PARTS", most)
    mesh = beside(bumpy(3), shifted(bumpy(3), [9, 0, 0]))
    keep = np.array([5, 700])
    some = surface(mesh, keep=keep, limit=600, samples=300)
    assert set(keep) <= set(some.samples) and 150 < len(some.samples) < 600
    drawn = Mesh(mesh.V[some.samples][used := np.unique(some.faces)], np.searchsorted(used, some.faces))
    assert drawn.volume == pytest.approx(mesh.volume, rel=0.1)
    values = mesh.V[:, 0]
    assert np.isfinite(some.mean(values)).all()
    assert np.abs(some.mean(values) - values[some.samples]).max() < 0.5


def test_components_that_touch_stay_apart_and_small_ones_whole():
    button = Mesh(0.05 * icosphere(1).V + bumpy(3).V[7], icosphere(1).F)
    mesh = beside(bumpy(3), button)
    some = surface(mesh, keep=np.array([5]), limit=600, samples=300)
    part = mesh.component[some.samples]
    assert (part[some.faces] == part[some.faces[:, :1]]).all()
    assert (part == mesh.component[-1]).sum() == button.n and len(some.samples) < 400
    assert (mesh.component == part[some.cell]).all()


def test_a_view_says_what_it_leaves_out(monkeypatch):
    monkeypatch.setattr(pictures, "HANDLES", 20)
    mesh = bumpy(3)
    handles = Handles(np.arange(50), mesh.V[:50] + [0, 0, 1], dynamic=np.arange(50) > 25)
    facts = packed_view(mesh, [ViewShape("rest", "", mesh.V)], handles=handles, label="x", size=(600, 150))
    assert facts["note"] == f"{facts['vertices']} of 642 vertices are shown. 20 of 50 handles are shown."
    assert len(facts["handles"]) == len(facts["dynamic"]) == len(facts["targets"]) == 20
    assert np.abs(np.array(facts["low"]) + np.array(facts["span"]) / 2).max() < 0.01  # about the centre
    assert facts["vertices"] < 200 and max(facts["handles"]) < 200

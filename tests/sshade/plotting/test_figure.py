"""Figures and their reduced meshes: drawn shapes, refused arguments, and the packed form."""

import base64
import gzip
import json
import re

import numpy as np
import pytest

import sshade
from sshade import DeformationResult, DeformationTask, Deformer, Mesh, plot
from sshade.plotting.figure import Figure
from sshade.plotting.view import pack, surface
from tests.shapes import beside, bumpy, end_handles, icosphere

REST = bumpy(2)
HANDLES = end_handles(REST.V, shift=(0.3, 0, 0.2))
TASK = DeformationTask("bend", REST, HANDLES)
RESULT = DeformationResult(REST.V * [1, 1, 1.2], 0, None)


def view(figure: Figure) -> dict:
    """Return the facts of a figure."""
    (case,) = json.loads(re.search(r'id="turn-cases"[^>]*>(.*?)</script>', figure.page, re.S)[1])["cases"]
    return case


def names(figure: Figure) -> list[str]:
    return [shape["name"] for shape in view(figure)["shapes"]]


def test_a_saved_page_is_whole_and_asks_for_nothing(here):
    figure = plot(RESULT.of(TASK), names=["</script><b>"])
    figure.save("figure.html")
    text = (here / "figure.html").read_text(encoding="utf-8")
    assert text == figure.page and "default-src 'none'" in text
    assert '"up": [0.0, 1.0, 0.0]' in text
    assert re.findall(" (?:src|href)=|@import|url\\(", text) == [] and "</script><b>" not in text
    assert names(figure)[1] == "</script><b>"


def test_results_know_their_tasks_without_copies_of_arrays():
    result = sshade.deform(TASK)
    assert result.task is TASK and "task" not in repr(result)
    moved = sshade.deform(TASK, method=lambda task, **_: RESULT)
    assert moved.task is TASK and moved.vertices is RESULT.vertices and RESULT.task is None
    drag = Deformer(REST, HANDLES.index, group=HANDLES.group)
    assert np.array_equal(drag.step(HANDLES.target).task.handles.target, HANDLES.target)
    assert drag.settle().task.mesh is REST
    for pose in sshade.deform_sequence(TASK, [HANDLES.target, HANDLES]):
        assert pose.task.mesh is REST and pose.task.guess is None
    transferred = sshade.transfer_pose(REST, 2 * REST.V, samplings=1)
    assert names(plot(transferred)) == ["rest", "result"]


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


def test_components_that_touch_stay_apart_and_small_ones_whole():
    button = Mesh(0.05 * icosphere(1).V + bumpy(3).V[7], icosphere(1).F)
    mesh = beside(bumpy(3), button)
    some = surface(mesh, keep=np.array([5]), limit=600, samples=300)
    part = mesh.component[some.samples]
    assert (part[some.faces] == part[some.faces[:, :1]]).all()
    assert (part == mesh.component[-1]).sum() == button.n and len(some.samples) < 400
    assert (mesh.component == part[some.cell]).all()

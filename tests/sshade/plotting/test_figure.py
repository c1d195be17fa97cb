"""Figures and their reduced meshes: drawn shapes, refused arguments, and the packed form."""

import base64
import gzip
import json
import re
from dataclasses import replace

import numpy as np
import pytest
import pyvista
import trimesh

import sshade
from sshade import DeformationResult, DeformationTask, Deformer, Handles, InputError, Mesh, TransferTask, plot
from sshade.files.arrays import Arrays
from sshade.plotting import pictures
from sshade.plotting import view as module
from sshade.plotting.figure import Figure
from sshade.plotting.pictures import edge_error
from sshade.plotting.view import ViewShape, pack, packed_view, surface
from tests.refusals import refusals
from tests.shapes import beside, bumpy, end_handles, icosphere, shifted

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


def test_a_task_shows_its_handles_and_its_truth():
    facts = view(plot(TASK))
    assert facts["handles"] == HANDLES.index.tolist() and facts["dynamic"] == HANDLES.dynamic.tolist()
    centre = 0.5 * (REST.V.min(axis=0) + REST.V.max(axis=0))
    expected = (HANDLES.target - centre) / REST.diagonal
    np.testing.assert_allclose(facts["targets"], expected, atol=1e-6)
    assert names(plot(replace(TASK, truth=RESULT.vertices))) == ["rest", "truth"]
    assert view(plot(REST, HANDLES))["targets"] == facts["targets"]


def test_a_result_is_coloured_by_the_change_of_its_edges():
    facts = view(plot(RESULT.of(TASK)))
    shown = [(shape["name"], shape["error"]) for shape in facts["shapes"]]
    assert shown == [("rest", False), ("result", True)]
    assert facts["label"] == "change of edge length (%)" and facts["bottom"] == 0
    assert facts["top"] == pytest.approx(np.percentile(edge_error(REST, RESULT.vertices), 98))
    assert facts["handles"] == HANDLES.index.tolist()
    few = Handles(HANDLES.index[:3], HANDLES.target[:3])  # these replace the handles of the task
    assert view(plot(TASK, few))["handles"] == few.index.tolist()


def test_poses_of_all_kinds_are_shapes_of_one_figure():
    V, F = np.array(REST.V), np.array(REST.F)
    other = Mesh(1.5 * V, F)
    assert names(plot(REST, RESULT, RESULT)) == ["rest", "result 1", "result 2"]
    assert names(plot(V, F, 2 * V, other)) == ["rest", "pose 1", "pose 2"]
    assert names(plot(Arrays(V, F), RESULT, (2 * V).tolist())) == ["rest", "result", "pose"]
    assert names(plot(RESULT.of(TASK), RESULT.of(TASK), names=["fast", "fine"])) == ["rest", "fast", "fine"]
    assert names(plot(REST, RESULT.of(TASK), other)) == ["rest", "result", "pose"]
    transfer = TransferTask("t", REST, other, 2 * V, truth=3 * V)
    assert names(plot(RESULT.of(transfer))) == ["rest", "result"]
    assert names(plot(transfer)) == ["rest", "truth"]


def test_meshes_of_trimesh_and_pyvista_are_taken_with_vertices_that_no_face_uses():
    V, F = np.vstack([[9.0, 9, 9], REST.V]), REST.F + 1
    shape = trimesh.Trimesh(V, F, process=False)
    handles = Handles(HANDLES.index + 1, HANDLES.target)
    facts = view(plot(shape, handles, 2 * V, values=np.arange(len(V))))
    assert facts["vertices"] == REST.n and facts["handles"] == HANDLES.index.tolist()
    assert (facts["bottom"], facts["top"]) == (1, REST.n)
    with pytest.raises(InputError, match="handle vertex 0 belongs to no face"):
        plot(shape, Handles([0], V[:1]))
    poly = pyvista.PolyData.from_regular_faces(REST.V, REST.F)
    assert names(plot(poly, poly)) == ["rest", "pose"]


def test_values_colour_all_shapes_from_the_least_to_the_greatest():
    facts = view(plot(REST, RESULT, values=REST.V[:, 2], label="z (m)"))
    assert all(shape["error"] for shape in facts["shapes"]) and facts["label"] == "z (m)"
    assert (facts["bottom"], facts["top"]) == (REST.V[:, 2].min(), REST.V[:, 2].max())
    for one in (2.0, 1e30, -1e30):  # the range is not empty
        assert view(plot(REST, values=np.full(REST.n, one)))["top"] > one


MISTAKES = {
    "there is no mesh to plot: plot takes meshes": lambda: plot(),
    "pass the mesh first": lambda: plot(HANDLES),
    "the mesh of a result is missing, because it knows no task": lambda: plot(RESULT),
    "pass poses of one mesh": lambda: plot(REST, REST.V[1:]),
    "NaN or infinite coordinate in the pose": lambda: plot(REST, REST.V * np.nan),
    "a further mesh has 42 vertices and 80 faces, and the first mesh 162": lambda: plot(REST, icosphere(1)),
    "not the rest shape that comes first": lambda: plot(Mesh(2 * REST.V, REST.F), TASK),
    "one object of handles": lambda: plot(REST, HANDLES, HANDLES),
    "all vertices of the mesh coincide": lambda: plot(Mesh(np.eye(3)[[0, 0, 0]], [[0, 1, 2]])),
    "1 poses follow the rest shape, and names has 2": lambda: plot(REST, RESULT, names=["a", "b"]),
    'differ from each other and from "rest"': lambda: plot(REST, RESULT, names=["rest"]),
    "one finite number for each of the 162 vertices": lambda: plot(REST, values=[1.0, 2]),
    'up is "y" or "z"': lambda: plot(REST, up="x"),
}

test_a_mistake_is_one_sentence = refusals(MISTAKES)


def test_a_saved_page_is_whole_and_asks_for_nothing(here):
    figure = plot(RESULT.of(TASK), names=["</script><b>"])
    figure.save("figure.html")
    text = (here / "figure.html").read_text(encoding="utf-8")
    assert text == figure.page and "default-src 'none'" in text
    assert '"up": [0.0, 1.0, 0.0]' in text
    for more in ({}, {"values": REST.V[:, 2]}):
        assert '"up": [0.0, 0.0, 1.0]' in plot(REST, up="z", **more).page
    assert re.findall(" (?:src|href)=|@import|url\\(", text) == [] and "</script><b>" not in text
    assert names(figure)[1] == "</script><b>"
    with pytest.raises(InputError, match="unknown format"):
        figure.save("figure.png")
    with pytest.raises(InputError, match="no such folder|does not exist"):
        figure.save("none/figure.html")


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


@pytest.mark.parametrize("most", [200, 1])
def test_a_large_mesh_of_several_components_is_shown_by_parts_or_clusters(most, monkeypatch):
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
